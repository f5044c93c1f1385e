// Signed releases: a folder of files with two files that show that it is whole and whose it is.
//
//   SHA256SUMS      "# myograde release NAME", and for each other file a line as sha256sum writes
//                   it ("HEX  PATH"), sorted by path
//   SHA256SUMS.sig  the 64 bytes of the Ed25519 signature of SHA256SUMS, by a key like that of
//                   receipts
//
// Whoever has no MyoGrade yet checks them with openssl and sha256sum. The first line keeps a release
// from ever being taken for a receipt or a head, which are JSON.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <absl/status/statusor.h>

#include "server/proof/signing_key.h"

namespace myograde::server {

inline constexpr char kReleaseSums[] = "SHA256SUMS";
inline constexpr char kReleaseSignature[] = "SHA256SUMS.sig";

// What the two files are, without writing them.
struct SignedRelease {
  std::string sums;       // the content of SHA256SUMS
  std::string signature;  // the content of SHA256SUMS.sig
  int64_t files = 0;      // that SHA256SUMS lists
};

// Signs the files in and below `folder` (but the two above). InvalidArgumentError: `name` is not 1
// to 64 printable characters of ASCII; the folder has no file, a link, or a name that sums can't
// list (control characters, backslashes).
absl::StatusOr<SignedRelease> SignRelease(const std::string& folder, const std::string& name,
                                          const SigningKey& key);

struct ReleaseCheck {
  std::string name;                // of the release; "" if its signature is not valid
  int64_t files = 0;               // listed
  std::vector<std::string> wrong;  // one sentence each; none: the release is whole and signed
};

// Checks a folder against its two files. Where the signature is wrong, nothing else is looked at,
// as the list may be anybody's. An error if the folder or one of the two can't be read.
absl::StatusOr<ReleaseCheck> CheckRelease(const std::string& folder, const PublicKey& key);

}  // namespace myograde::server
