#include "server/base/harmless.h"

#include <cstddef>

#include "server/base/plain_text.h"

namespace myograde::server {

std::string Harmless(std::string_view text, bool tabs) {
  std::string harmless;
  for (size_t at = 0; at < text.size();) {
    const size_t begin = at;
    const char32_t c = TakeCodePoint(text, at);
    // A terminal that is not UTF-8's may obey a byte of 0x80 to 0x9f that stands alone.
    if (!(tabs && c == '\t') && (c == kBroken || IsHarmful(c))) {
      harmless += '?';
    } else {
      harmless.append(text, begin, at - begin);
    }
  }
  return harmless;
}

}  // namespace myograde::server
