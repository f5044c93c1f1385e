// The network of a participant's sandbox: a loopback that carries LCM.
#pragma once

namespace myograde::server {

// Brings up `lo` of the calling process' network namespace, with multicast and
// a route for 239.255.0.0/16, LCM's groups. System calls only, so that it may be used
// between fork and exec. Returns 0 or the errno of what failed. REQUIRES:
// CAP_NET_ADMIN over that namespace.
int SetUpLoopback();

}  // namespace myograde::server
