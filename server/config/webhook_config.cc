#include "server/config/webhook_config.h"

#include <algorithm>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

constexpr size_t kMaxWebhookName = 64;

bool IsWebhookName(const std::string& name) {
  return !name.empty() && name.size() <= kMaxWebhookName &&
         std::all_of(name.begin(), name.end(), [](char c) {
           return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
                  c == '.' || c == '_' || c == '-';
         });
}

std::string AbsolutePath(ConfigReader& reader, const char* key) {
  const std::string path = reader.String(key);
  if (!path.starts_with('/')) reader.Fail(key, "must be the absolute path of a file");
  return path;
}

void ReadEvents(ConfigReader& reader, WebhookConfig& webhook) {
  const std::vector<std::string> known(std::begin(kWebhookEvents), std::end(kWebhookEvents));
  for (const nlohmann::json& entry : reader.Array("events")) {
    const std::string event = entry.is_string() ? entry.get<std::string>() : "";
    if (std::find(known.begin(), known.end(), event) == known.end()) {
      return reader.Fail("events", absl::StrCat("has ", entry.dump(), "; each must be one of ",
                                                absl::StrJoin(known, ", ")));
    }
    webhook.events.insert(event);
  }
  if (webhook.events.empty()) reader.Fail("events", "must name at least one event");
}

absl::StatusOr<WebhookConfig> ReadWebhook(const nlohmann::json& json, const std::string& where) {
  ConfigReader reader(json, where);
  WebhookConfig webhook;
  webhook.name = reader.String("name");
  if (reader.mistake().ok() && !IsWebhookName(webhook.name)) {
    reader.Fail("name", absl::StrCat("must be 1 to ", kMaxWebhookName,
                                     " letters, digits, \".\", \"_\" and \"-\""));
  }
  webhook.url = reader.String("url");
  webhook.secret_file = AbsolutePath(reader, "secret_file");
  if (reader.mistake().ok()) ReadEvents(reader, webhook);
  if (reader.Has("ca_file")) webhook.ca_file = AbsolutePath(reader, "ca_file");
  if (reader.Has("timeout_s")) {
    webhook.timeout = absl::Seconds(reader.Number("timeout_s", {0.1, 60}));
  }
  if (reader.Has("give_up_after_h")) {
    webhook.give_up_after = absl::Hours(1) * reader.Number("give_up_after_h", {0.001, 720});
  }
  RETURN_IF_ERROR(reader.Finish());
  return webhook;
}

}  // namespace

absl::StatusOr<std::vector<WebhookConfig>> ReadWebhooks(const nlohmann::json& json,
                                                        const std::string& where) {
  std::vector<WebhookConfig> webhooks;
  std::set<std::string> names;
  if (json.size() > kMostWebhooks) {
    return absl::InvalidArgumentError(
        absl::StrCat(where, ": has ", json.size(), " entries; ", kMostWebhooks, " are the most"));
  }
  for (size_t i = 0; i < json.size(); ++i) {
    const std::string place = absl::StrCat(where, "[", i, "]");
    ASSIGN_OR_RETURN(WebhookConfig webhook, ReadWebhook(json[i], place));
    if (!names.insert(webhook.name).second) {
      return absl::InvalidArgumentError(
          absl::StrCat(place, ": \"name\" is \"", webhook.name, "\", as is an earlier one's"));
    }
    webhooks.push_back(std::move(webhook));
  }
  return webhooks;
}

}  // namespace myograde::server
