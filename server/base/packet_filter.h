// Whether this process may send packets to other hosts, where a service manager can forbid it.
#pragma once

#include <optional>

#include "server/base/ip_address.h"

namespace myograde::server {

// Whether the kernel refuses to send packets of this process to `address` (systemd's
// IPAddressDeny=). Sends an empty datagram to the discard port there.
bool IsRefused(const IpAddress& address);

// An address of this host that other hosts reach; nullopt if it has none. What is sent to it stays
// on this host, but is filtered like everything that leaves it.
std::optional<IpAddress> OwnAddress();

}  // namespace myograde::server
