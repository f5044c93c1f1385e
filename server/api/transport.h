// How the bytes of a connection get over its socket: as they are, or through TLS (tls.h). Nothing
// here waits.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string_view>

namespace myograde::server {

// For one thread at a time.
class Transport {
 public:
  enum class Outcome {
    kDone,     // bytes were moved, or the handshake has ended well
    kBlocked,  // nothing can be done before the socket is ready for what Wants says
    kEnded,    // the other end sends nothing more
    kLost,     // nothing can be moved any more
  };
  struct Moved {
    Outcome outcome = Outcome::kLost;
    size_t bytes = 0;  // 0 unless kDone
  };

  virtual ~Transport() = default;

  // Whether bytes can be moved yet; before that, only Handshake may be called.
  virtual bool established() const = 0;
  // Goes on with what the two ends have to agree on first.
  virtual Outcome Handshake() = 0;
  // Whether the handshake broke because the other end sent a request of plain HTTP.
  virtual bool met_plain_http() const = 0;

  virtual Moved Read(char* to, size_t size) = 0;
  // Bytes that are here already, of which the socket's readiness tells nothing.
  virtual size_t pending() const = 0;
  // After kBlocked, the next call must begin with the same bytes.
  virtual Moved Write(std::string_view bytes) = 0;
  // Tells the other end that nothing more will be sent, if that is possible at once.
  virtual void EndSending() = 0;
  // The readiness (of epoll) to wait for before the next read, or with `to_send` the next write.
  virtual uint32_t Wants(bool to_send) const = 0;
};

// Bytes as they are. The socket `fd` must not block, and outlive it.
std::unique_ptr<Transport> MakePlainTransport(int fd);

}  // namespace myograde::server
