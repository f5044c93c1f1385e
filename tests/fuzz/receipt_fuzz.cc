// Receipts, which `verify` accepts from anybody: parsed, with every claim checked against the
// content.
#include "protocol/base/config_reader.h"
#include "server/proof/receipt.h"
#include "tests/fuzz/fuzz.h"

using namespace myograde;
using namespace myograde::server;
using fuzz::Require;

namespace {

const SigningKey& Key() {
  static const fuzz::Folder folder;
  static const SigningKey key = [] {
    auto made = SigningKey::LoadOrMake(folder / "key");
    Require(made.ok(), "a key can be made");
    return *std::move(made);
  }();
  return key;
}

const PublicKey& Public() {
  static const PublicKey key = *PublicKey::Parse(Key().PublicPem(), "key");
  return key;
}

void Check(const std::string& text, bool may_be_signed) {
  const absl::StatusOr<nlohmann::json> receipt = ParseReceipt(text);
  if (!receipt.ok()) {
    Require(absl::IsDataLoss(receipt.status()), "what is not a receipt is told so");
    return;
  }
  const std::vector<ReceiptCheck> checks = CheckReceipt(text, Public());
  for (const ReceiptCheck& check : checks) {
    Require(!check.name.empty() && (check.valid || !check.detail.empty()), "a 'no' has its reason");
  }
  Require(!checks.empty() && checks[0].name == "signature", "the signature is checked first");
  Require(checks[0].valid == may_be_signed, "only the key's owner can sign");
  const std::string secret(32, 's');
  for (const ReceiptCheck& check : CheckReceipt(text, Public(), secret)) {
    Require(!check.name.empty() && (check.valid || !check.detail.empty()), "a 'no' has its reason");
  }
  if (HidesSeeds(*receipt)) {
    const absl::StatusOr<nlohmann::json> opened = OpenedReceipt(*receipt, secret);
    Require(opened.ok() || absl::IsInvalidArgument(opened.status()) ||
                absl::IsFailedPrecondition(opened.status()),
            "a config that can't be read is told");
  }
  const nlohmann::json here = {{"simulator", "a"}, {"mujoco", nullptr}, {"models", {{"x-1", "b"}}}};
  for (const ReceiptCheck& check : CompareGraders(*receipt, here)) {
    Require(!check.name.empty(), "a check has a name");
  }
}

}  // namespace

// The first byte: a file, or the signed part of one, which is signed here.
MYOGRADE_FUZZ_TARGET(receipt)(const uint8_t* data, size_t size) {
  fuzz::Input input(data, size);
  const bool whole = (input.Byte() & 1) == 0;
  const std::string text = input.RestText();
  if (whole) {
    Check(text, /*may_be_signed=*/false);
    (void)PublicKey::Parse(text, "input");
    return 0;
  }
  const absl::StatusOr<nlohmann::json> receipt = ParseJson(text, "receipt");
  if (!receipt.ok()) return 0;
  const absl::StatusOr<std::string> file = SignReceipt(*receipt, Key());
  Require(file.ok(), "anything can be signed");
  Check(*file, /*may_be_signed=*/true);
  return 0;
}
