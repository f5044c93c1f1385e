// The files of the web pages, as compiled in.
#pragma once

#include <span>
#include <string_view>

namespace myograde::server {

struct WebFile {
  std::string_view path;  // of its address
  std::string_view type;  // of its content
  std::string_view text;
  std::string_view packed;  // the text compressed by gzip; empty if that is not smaller
};

// All of them, in the order of their paths. They live as long as the program.
std::span<const WebFile> WebFiles();

}  // namespace myograde::server
