// Where the data folder, its socket and the cache are.
#pragma once

#include <string>

namespace myograde::server {

// Each takes the value of its option, "" if not given.
std::string DataDir(const std::string& option);   // --data, MYOGRADE_DATA, or the default
std::string CacheDir(const std::string& option);  // --cache, MYOGRADE_CACHE, or the default
std::string SocketPath(const std::string& socket_option, const std::string& data_option);

}  // namespace myograde::server
