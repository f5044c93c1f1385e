#include "server/base/secret.h"

#include <fcntl.h>
#include <openssl/rand.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include <absl/strings/str_cat.h>

#include "protocol/base/fd.h"
#include "protocol/base/file.h"

namespace myograde::server {

absl::StatusOr<std::string> RandomBytes(size_t size) {
  std::string bytes(size, '\0');
  if (RAND_bytes(reinterpret_cast<unsigned char*>(bytes.data()), static_cast<int>(size)) != 1) {
    return absl::InternalError("this host gives no random bytes");
  }
  return bytes;
}

absl::StatusOr<std::string> ReadSecretFile(const std::string& path, size_t min, size_t max) {
  // Opening a pipe must not wait for its other end.
  const Fd file(open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  struct stat info;
  if (!file.valid() || fstat(file.get(), &info) != 0) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": the secret can't be read (", std::strerror(errno),
                     "); make the file, and let the user that runs the daemon read it"));
  }
  if (!S_ISREG(info.st_mode)) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": is not a file; name one with the secret"));
  }
  if ((info.st_mode & 077) != 0) {
    return absl::InvalidArgumentError(absl::StrCat(
        path, ": others than its owner may read or write this secret; run \"chmod 600 ", path,
        "\""));
  }
  absl::StatusOr<std::string> text = ReadAll(file.get(), path, max + 2);
  if (text.ok() && text->ends_with('\n')) text->pop_back();
  const bool printable = text.ok() && std::all_of(text->begin(), text->end(), [](char c) {
                           return c > ' ' && c <= '~';
                         });
  if (!printable || text->size() < min || text->size() > max) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": must hold one line of ", min, " to ", max,
                     " printable characters without spaces; \"openssl rand -hex 32\" makes one"));
  }
  return text;
}

}  // namespace myograde::server
