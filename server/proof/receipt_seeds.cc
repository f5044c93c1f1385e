#include "server/proof/receipt_seeds.h"

#include <optional>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/policy_seed.h"
#include "protocol/lease/seed_commitment.h"
#include "protocol/lease/track_config.h"
#include "server/proof/seed_list.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

bool IsDigest(const Json& json) {
  return json.is_string() && IsSha256Hex(json.get_ref<const std::string&>());
}

bool InOrder(const Json& episodes) {
  size_t next = 0;
  for (const Json& entry : episodes) {
    if (entry["index"] != next++) return false;
  }
  return true;
}

// The policy seeds must follow from the secret that the config names. Receipts that hide seeds name
// none.
std::optional<ReceiptCheck> CheckPolicySeeds(const Json& receipt) {
  const std::string secret =
      TextOf(receipt.value("track_config", Json::object()), "policy_seed_secret");
  if (secret.empty()) return std::nullopt;
  const Json said = receipt.value("policy_seeds", Json());
  const Json& episodes = receipt["episodes"];
  if (!said.is_array() || said.size() != episodes.size()) {
    return ReceiptCheck{"policy_seeds", false, "they are not as many as the episodes"};
  }
  for (size_t i = 0; i < said.size(); ++i) {
    const auto index = episodes[i]["index"].get<int64_t>();
    if (const uint64_t found = PolicySeed(secret, index); said[i] != found) {
      return ReceiptCheck{"policy_seeds", false,
                          absl::StrCat("the config's secret gives ", found, " for episode ", index,
                                       ", the receipt says ", said[i].dump().substr(0, 40))};
    }
  }
  return ReceiptCheck{"policy_seeds", true, ""};
}

std::string PhaseOf(const Json& receipt) { return TextOf(receipt["track_config"], "phase"); }

int64_t HiddenCount(const Json& receipt) { return receipt["hidden"]["count"].get<int64_t>(); }

// Each episode's commitment must be to the seed that the secret gives for it.
ReceiptCheck CheckCommitments(const Json& receipt, const std::string& salt,
                              const std::vector<uint64_t>& seeds) {
  for (const Json& entry : receipt["episodes"]) {
    const auto index = entry["index"].get<int64_t>();
    if (index >= std::ssize(seeds) ||
        entry["seed_commitment"] !=
            SeedCommitment(salt, index, seeds[static_cast<size_t>(index)])) {
      return {"seed_commitments", false,
              absl::StrCat("episode ", index,
                           " is not committed to the seed that the secret gives")};
    }
  }
  return {"seed_commitments", true, ""};
}

ReceiptCheck CheckCommitment(const Json& receipt, const std::string& secret) {
  const std::string found = SecretCommitment(secret);
  if (receipt["hidden"].value("commitment", Json()).is_null()) {
    return {"commitment", true,
            absl::StrCat("the receipt names none; hold what was published against ", found)};
  }
  return CompareTexts("commitment", TextOf(receipt["hidden"], "commitment"), found);
}

ReceiptCheck CheckHiddenList(const Json& receipt, const std::vector<uint64_t>& seeds) {
  if (receipt["episodes"].size() != seeds.size()) {
    return {"seeds", false, "there are not as many episodes as seeds"};
  }
  return CompareTexts("seeds", TextOf(receipt, "seeds"), SeedListHash(seeds));
}

}  // namespace

std::string TextOf(const Json& json, const char* key) {
  const auto it = json.find(key);
  return it != json.end() && it->is_string() ? it->get<std::string>() : std::string();
}

ReceiptCheck CompareTexts(const char* name, const std::string& said, const std::string& found) {
  ReceiptCheck check = {name, said == found, ""};
  if (!check.valid) {
    check.detail = absl::StrCat("the receipt says \"", said, "\", what it holds gives \"", found,
                                "\"");
  }
  return check;
}

bool HasHiddenShape(const Json& receipt) {
  const Json hidden = receipt.value("hidden", Json());
  const Json config = receipt.value("track_config", Json());
  if (!hidden.is_object() || !config.is_object() || TextOf(config, "phase").empty()) return false;
  const Json commitment = hidden.value("commitment", Json());
  const Json count = hidden.value("count", Json());
  if (!commitment.is_null() && !IsDigest(commitment)) return false;
  if (!count.is_number_unsigned() || count == 0 || count > kMaxEpisodes) return false;
  for (const Json& entry : receipt["episodes"]) {
    if (!IsDigest(entry.value("seed_commitment", Json())) || entry.contains("seed")) return false;
  }
  return true;
}

bool HidesSeeds(const Json& receipt) { return receipt["format"] == 2; }

std::vector<ReceiptCheck> CheckPublicSeeds(const Json& receipt) {
  std::vector<ReceiptCheck> checks;
  checks.push_back(CompareTexts("config", TextOf(receipt, "config"),
                                Sha256Hex(CanonicalJson(receipt.value("track_config", Json())))));
  std::vector<uint64_t> seeds;
  for (const Json& entry : receipt["episodes"]) seeds.push_back(entry["seed"].get<uint64_t>());
  checks.push_back(InOrder(receipt["episodes"])
                       ? CompareTexts("seeds", TextOf(receipt, "seeds"), SeedListHash(seeds))
                       : ReceiptCheck{"seeds", false, "episodes are missing or out of order"});
  if (std::optional<ReceiptCheck> check = CheckPolicySeeds(receipt); check.has_value()) {
    checks.push_back(*std::move(check));
  }
  return checks;
}

absl::StatusOr<Json> OpenedReceipt(const Json& receipt, const std::string& secret) {
  const std::string phase = PhaseOf(receipt);
  const PhaseSecrets secrets = SecretsOfPhase(secret, phase);
  Json config = receipt["track_config"];
  config["seeds"] = DeriveSeeds(secret, phase, HiddenCount(receipt));
  config["policy_seed_secret"] = secrets.policy_seed_secret;
  config["seed_salt"] = secrets.seed_salt;
  // The parser writes a list of seeds as it stands in the config that was hashed.
  ASSIGN_OR_RETURN(TrackConfig parsed, ParseTrackConfig(config, "track_config"));
  Json opened = receipt;
  opened["track_config"] = parsed.effective;
  opened["policy_seeds"] = Json::array();
  for (const Json& entry : receipt["episodes"]) {
    const auto index = entry["index"].get<int64_t>();
    opened["policy_seeds"].push_back(PolicySeed(secrets.policy_seed_secret, index));
  }
  return opened;
}

std::vector<ReceiptCheck> CheckHiddenSeeds(const Json& receipt, const std::string& secret) {
  std::vector<ReceiptCheck> checks;
  if (!InOrder(receipt["episodes"])) {
    checks.push_back({"seeds", false, "episodes are missing or out of order"});
  }
  if (secret.empty()) {
    checks.push_back({"hidden", true,
                      absl::StrCat("the seeds of the phase ", PhaseOf(receipt),
                                   " are not revealed to you yet, so config, seeds and policy "
                                   "seeds can't be checked; once they are, give --secret")});
    return checks;
  }
  checks.push_back(CheckCommitment(receipt, secret));
  const std::string phase = PhaseOf(receipt);
  const std::vector<uint64_t> seeds = DeriveSeeds(secret, phase, HiddenCount(receipt));
  checks.push_back(CheckCommitments(receipt, SecretsOfPhase(secret, phase).seed_salt, seeds));
  checks.push_back(CheckHiddenList(receipt, seeds));
  const absl::StatusOr<Json> opened = OpenedReceipt(receipt, secret);
  if (!opened.ok()) {
    checks.push_back({"config", false, std::string(opened.status().message())});
    return checks;
  }
  checks.push_back(CompareTexts("config", TextOf(receipt, "config"),
                                Sha256Hex(CanonicalJson((*opened)["track_config"]))));
  if (std::optional<ReceiptCheck> check = CheckPolicySeeds(*opened); check.has_value()) {
    checks.push_back(*std::move(check));
  }
  return checks;
}

}  // namespace myograde::server
