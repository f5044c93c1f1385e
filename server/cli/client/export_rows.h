// How much an export holds.
#pragma once

#include <string>

#include "server/store/transfer.h"

namespace myograde::server {

// "3 submissions and 300 episodes".
std::string RowsText(const ExportInfo& info);

}  // namespace myograde::server
