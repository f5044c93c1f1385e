#include "server/api/board_answers.h"

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "server/api/redaction.h"

namespace myograde::server {

KeptBoards::Text KeptBoards::Find(const Key& key, int64_t changes) {
  const MutexLock lock(mutex_);
  const Kept* kept = kept_.Find(key);
  return kept == nullptr || changes < 0 || kept->changes != changes ? nullptr : kept->text;
}

void KeptBoards::Keep(const Key& key, int64_t changes, Text text) {
  if (changes < 0) return;  // the count can't be read, so nobody could tell whether it is stale
  const MutexLock lock(mutex_);
  if (const Kept* kept = kept_.Find(key); kept != nullptr) {
    if (kept->changes >= changes) return;
    Drop(key);
  }
  bytes_ += text->size();
  while (kept_.size() > 0 && (kept_.size() >= most_ || bytes_ > most_bytes_)) {
    Drop(Key(kept_.oldest()));
  }
  kept_.FindOr(key, {changes, std::move(text)});
}

void KeptBoards::Drop(const Key& key) {
  bytes_ -= kept_.Find(key)->text->size();
  kept_.Forget(key);
}

absl::StatusOr<KeptBoards::Text> BoardAnswers::TextOf(const Transaction& reader,
                                                      const BoardQuery& asked) {
  const std::string& config = asked.track->config.hash;
  KeptBoards& kept = asked.at_ms == 0 && config == asked.config_in_force ? now_ : others_;
  const KeptBoards::Key key{config, asked.config_in_force, asked.board, asked.view(), asked.at_ms};
  const int64_t changes = reader.BoardChanges();
  if (auto found = kept.Find(key, changes); found != nullptr) return found;
  ASSIGN_OR_RETURN(const nlohmann::json made, make_(reader, asked));
  const auto text = std::make_shared<const std::string>(CanonicalJson(made) + "\n");
  kept.Keep(key, changes, text);
  return text;
}

ApiResult BoardAnswers::Get(const Request& request) {
  return context_.readers.Read<ApiAnswer>([&](const Transaction& reader) -> ApiResult {
    ASSIGN_OR_RETURN(const BoardQuery asked, ParseBoardQuery(request, reader, context_));
    ApiAnswer answer{.tagged = true};
    ASSIGN_OR_RETURN(answer.text, TextOf(reader, asked));
    answer.for_all_origins = IsPhasePublic(reader, context_, asked.track->config.phase);
    return answer;
  });
}

}  // namespace myograde::server
