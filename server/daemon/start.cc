#include "server/daemon/start.h"

#include <optional>
#include <set>
#include <string>
#include <vector>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>
#include <spdlog/spdlog.h>

#include "protocol/base/status_macros.h"
#include "server/base/ip_address.h"
#include "server/base/packet_filter.h"
#include "server/challenge/board_configs.h"
#include "server/webhook/sender.h"

namespace myograde::server {

absl::StatusOr<HomeFound> FindHome(const std::string& data, bool on_cluster, bool adopt) {
  const std::string store = data + "/store.db";
  ASSIGN_OR_RETURN(DataHome here, HomeOf(data));
  ASSIGN_OR_RETURN(const std::optional<DataHome> recorded, RecordedHome(store));
  HomeFound found = {std::move(here), ""};
  const bool copied = recorded.has_value() && recorded->key != found.home.key;
  if (copied && on_cluster && !adopt) {
    found.held_back = absl::StrCat(
        found.home.place, " is a copy of the data folder ", recorded->place,
        ", which may still grade, so this daemon touches no job; if it takes that one's place, stop "
        "it, run \"myograde serve --data ", data, " --adopt\" once, and start it again");
    spdlog::error("{}", found.held_back);
    return found;
  }
  if (copied && !adopt) {
    spdlog::warn("{} is a copy of the data folder {}, and a server of its own from now on",
                 found.home.place, recorded->place);
  }
  if (!recorded.has_value() || copied || recorded->place != found.home.place) {
    RETURN_IF_ERROR(RecordHome(store, found.home));
  }
  return found;
}

absl::StatusOr<Phases> MakePhases(const DaemonConfigs& configs, Store& store) {
  const auto secret_of = [&](const PhaseConfig& phase) {
    absl::StatusOr<std::string> secret = absl::InternalError("");
    const absl::Status written = store.Write([&](Writer& writer) {
      secret = writer.PhaseSecret(phase.name, phase.challenge);
      return secret.status();
    });
    return written.ok() ? secret : absl::StatusOr<std::string>(written);
  };
  return Phases::Make(configs.challenges, configs.tracks, secret_of);
}

absl::Status TakeConfigsInForce(Store& store, ReaderPool& readers, Tracks& tracks,
                                Phases& phases) {
  ASSIGN_OR_RETURN(Overlaid overlaid, readers.Read<Overlaid>([&](Reader& reader) {
    return OverlayConfigs(reader, tracks, phases);
  }));
  for (const std::string& note : overlaid.notes) spdlog::info("{}", note);
  for (const std::string& warning : overlaid.warnings) spdlog::warn("{}", warning);
  for (const std::string& error : overlaid.errors) spdlog::error("{}", error);
  if (overlaid.changed.empty()) return absl::OkStatus();
  return store.Write([&](Writer& writer) {
    for (const NewBoardConfig& change : overlaid.changed) {
      RETURN_IF_ERROR(writer.SetBoardConfig(change, "daemon").status());
    }
    return absl::OkStatus();
  });
}

absl::Status SetWebhooks(const std::vector<Webhook>& webhooks, Store& store) {
  store.SetSubscriptions(SubscriptionsOf(webhooks));
  std::set<std::string> names;
  for (const Webhook& webhook : webhooks) names.insert(webhook.config.name);
  return store.Write([&](Writer& writer) -> absl::Status {
    ASSIGN_OR_RETURN(const int64_t given_up, writer.GiveUpStrangers(names));
    if (given_up > 0) {
      spdlog::warn("{} events are given up: server.json has not their webhooks any more", given_up);
    }
    return absl::OkStatus();
  });
}

void WarnOfFilteredPackets(const DaemonConfigs& configs, bool handed) {
  std::vector<std::string> wanted;
  const std::optional<ListenConfig>& listen = configs.server.listen;
  if (listen.has_value() && !handed) {
    const std::optional<IpAddress> address = IpAddress::Parse(listen->address);
    if (!address.has_value() || !address->IsLoopback()) wanted.push_back("listen");
  }
  for (const Webhook& webhook : configs.webhooks) {
    // Without TLS they are for this host only.
    if (webhook.config.url.starts_with("https:")) wanted.push_back("webhook " + webhook.config.name);
  }
  if (configs.server.on_cluster) wanted.push_back("executor");
  const std::optional<IpAddress> own = wanted.empty() ? std::nullopt : OwnAddress();
  if (!own.has_value() || !IsRefused(*own)) return;
  spdlog::warn(
      "this service may not send packets to other hosts (IPAddressDeny= of its unit), which {} of "
      "server.json need: enable myograded-https.socket for listen, and for the rest copy network.conf "
      "from /usr/share/myograde/systemd to /etc/systemd/system/myograded.service.d",
      absl::StrJoin(wanted, ", "));
}

absl::Status LogPhases(const Phases& phases, ReaderPool& readers, absl::Time now) {
  for (const auto& [name, why] : phases.unusable()) {
    spdlog::error("phase \"{}\" takes nothing: {}", name, std::string(why.message()));
  }
  return readers.Read([&](Reader& reader) {
    std::vector<ChallengeConfig> usable = phases.challenges();
    for (ChallengeConfig& challenge : usable) {
      std::erase_if(challenge.phases, [&](const PhaseConfig& phase) {
        return phases.unusable().contains(phase.name);
      });
    }
    const auto contradicted = CheckAgainstStore(usable, reader, now);
    for (const std::string& sentence : contradicted.value_or(std::vector<std::string>())) {
      spdlog::error("{}", sentence);
    }
    const absl::StatusOr<std::vector<PhaseUse>> uses = reader.PhasesInUse();
    if (!uses.ok()) {
      spdlog::error("{}", std::string(uses.status().message()));
      return absl::OkStatus();
    }
    for (const PhaseUse& use : *uses) {
      if (phases.ConfigOf(use.phase) != nullptr) continue;
      spdlog::info("phase \"{}\" has {} submissions and no file: it is closed, and its board is "
                   "shown in full", use.phase, use.submissions);
    }
    return absl::OkStatus();
  });
}

absl::Status StartRecord(Store& store, ReaderPool& readers, KeyFile& receipts_key,
                         RecordLog& record) {
  bool any = false;
  absl::Status status = readers.Read([&](Reader& reader) {
    any = reader.RecordSize() > 0;
    return absl::OkStatus();
  });
  if (const auto key = receipts_key.Get(); status.ok() && any && key.ok()) {
    status = store.Write(
        [pem = (*key)->PublicPem()](Writer& writer) { return writer.AppendKey(pem); });
  }
  if (!status.ok()) return status;
  return readers.Read([&](Reader& reader) -> absl::Status {
    ASSIGN_OR_RETURN(const std::vector<Damage> damaged, record.Damaged(reader));
    for (const Damage& damage : damaged) spdlog::error("{}", DamageText(damage));
    return absl::OkStatus();
  });
}

}  // namespace myograde::server
