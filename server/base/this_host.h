// This host among others: its name, and what it may send them.
#pragma once

#include <optional>
#include <string>

#include "server/base/ip_address.h"

namespace myograde::server {

// "unknown" if it has none.
std::string HostName();

// Whether the kernel refuses to send packets of this process to `address` (systemd's
// IPAddressDeny=). Sends an empty datagram to the discard port there.
bool IsRefused(const IpAddress& address);

// An address of this host that other hosts reach; nullopt if it has none. What is sent to it stays
// on this host, but is filtered like everything that leaves it.
std::optional<IpAddress> OwnAddress();

}  // namespace myograde::server
