// What nodes of a cluster send: claims, proofs and ends of leases; and orders, which another host
// wrote. An accepted form is written and read again to the same text.
#include "server/executor/spool/forms.h"
#include "tests/fuzz/fuzz.h"

using namespace myograde;
using namespace myograde::server;
using fuzz::Require;

namespace {

template <typename Form>
void Check(std::string_view text, absl::StatusOr<Form> (*read)(std::string_view, const std::string&),
           std::string (*write)(const Form&)) {
  const absl::StatusOr<Form> form = read(text, "form");
  if (!form.ok()) {
    Require(!form.status().message().empty(), "a refusal says why");
    return;
  }
  const std::string written = write(*form);
  Require(written.find('\n') == std::string::npos, "a form is one line");
  const absl::StatusOr<Form> again = read(written, "form");
  Require(again.ok() && write(*again) == written, "a form keeps its values");
}

void CheckNames(std::string_view text) {
  for (const auto& is_name : {IsLeaseName, IsNodeName, IsLogName, IsDigest}) {
    Require(!is_name(text) || text.find('/') == std::string_view::npos, "a name leads nowhere");
    Require(!is_name(text) || (text != "." && text != ".."), "a name is no folder above");
  }
}

}  // namespace

MYOGRADE_FUZZ_TARGET(node_form)(const uint8_t* data, size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  CheckNames(text);
  Check(text, NodeClaimFromText, NodeClaimToText);
  Check(text, NodeProofFromText, NodeProofToText);
  Check(text, NodeEndFromText, NodeEndToText);
  Check(text, NodeOrderFromText, NodeOrderToText);
  return 0;
}
