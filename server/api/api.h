// The HTTP API (README.md): requests are checked here, read from the store on
// connections of their own, and handed to the engine where they change something.
#pragma once

#include <atomic>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "protocol/base/clock.h"
#include "server/api/api_error.h"
#include "server/api/unix_http_server.h"
#include "server/artefact/known_archives.h"
#include "server/engine/engine.h"
#include "server/proof/reference_check.h"
#include "server/proof/signing_key.h"

namespace myograde::server {

// The answer to a status of the store, the engine or a check.
ApiError ErrorOf(const absl::Status& status);

class Api {
 public:
  struct Options {
    ServerConfig config;
    std::string data_dir;
    std::string cache_dir;
    const ReferenceCheck* reference = nullptr;  // null: every result of this host may rank
    absl::Time started_at;
  };

  // All must outlive the server that Install is called on.
  Api(Options options, const Tracks& tracks, Engine& engine, ReaderPool& readers,
      KeyFile& receipts_key, const Clock& clock);

  // Adds every address of the API to `server`.
  void Install(UnixHttpServer& server);

 private:
  using Json = nlohmann::json;
  using Request = httplib::Request;
  struct Answer {
    int http = 200;
    Json body = nullptr;
    std::shared_ptr<const std::string> text = nullptr;  // in place of body, if set
  };
  using Result = std::variant<Answer, ApiError>;

  static std::string Who();
  static void SendAnswer(httplib::Response& response, const Answer& answer);
  static void SendError(httplib::Response& response, const ApiError& error);
  void Get(UnixHttpServer& server, const std::string& pattern,
           Result (Api::*handler)(const Request&));
  void Post(UnixHttpServer& server, const std::string& pattern,
            Result (Api::*handler)(const Request&, const Json& body));

  Result Health(const Request& request);
  Result ListTracks(const Request& request);
  Result ListSubmissions(const Request& request);
  Result GetSubmission(const Request& request);
  Result GetResult(const Request& request);
  Result GetEvaluation(const Request& request);
  Result GetLeaderboard(const Request& request);
  Result Explain(const Request& request);
  Result GetQuota(const Request& request);
  Result Submit(const Request& request, const Json& body);
  Result Cancel(const Request& request, const Json& body);
  Result Rerun(const Request& request, const Json& body);
  Result Mark(const Request& request, const Json& body);
  Result RebuildBoards(const Request& request, const Json& body);
  Result Grant(const Request& request, const Json& body);
  // What forbids to grade ranked submissions here; waits for it if need be.
  std::optional<ApiError> RefuseRanked() const;
  Result GetReceipt(const Request& request);
  Result GetKey(const Request& request);
  void SendLog(const Request& request, httplib::Response& response);
  Result Upload(const Request& request);

  Result Import();
  void InstallTransfer(UnixHttpServer& server);
  std::string SpoolPath();
  absl::Status MakeExport(const std::string& path);
  void SendMade(const char* type, httplib::Response& response,
                const std::function<absl::Status(const std::string&)>& make);

  absl::StatusOr<Json> Status(Reader& reader, int64_t submission);
  absl::StatusOr<Json> Breakdown(Reader& reader, int64_t evaluation, bool episodes);
  // The track and board that the parameters name.
  struct BoardQuery {
    TrackPtr track;
    std::string board;
    const scoring::BoardSpec* rules = nullptr;
  };
  std::variant<BoardQuery, ApiError> ParseBoardQuery(const Request& request);
  absl::StatusOr<std::string> MakeBoardText(Reader& reader, const BoardQuery& asked);
  // NotFoundError if the artefact is known and its files were removed, or it came
  // with an import.
  absl::Status HasFiles(const std::string& artefact) const;
  // Refuses who is neither root nor the daemon's own user.
  std::optional<ApiError> OnlyOrganiser() const;
  absl::StatusOr<Json> QuotaOf(Reader& reader, const std::string& team, const std::string& track);
  // Refuses an upload of a team that has used up its failed tries.
  absl::Status CheckTries(const std::string& team, const std::string& track);
  // The answer to a status of an operation that takes a team's name; tells the organiser
  // which team a name that was refused looks like.
  ApiError TeamErrorOf(const absl::Status& status, const std::string& team) const;
  // A failed try of the team, if there is one.
  absl::Status ChargeRefusal(const std::string& team, const std::string& track,
                             const std::string& why);
  Result EvaluationAnswer(int64_t evaluation, bool of_submission, const Request& request);
  // Unpacks the request's body and enters it into the store as `upload` says.
  absl::StatusOr<ArtefactRow> Receive(const NewUpload& upload, bool& is_new);
  // The artefact of an archive that came before. NotFoundError: unpack it.
  absl::StatusOr<ArtefactRow> Known(const std::string& archive_sha256);

  const Options options_;
  const Tracks& tracks_;
  Engine& engine_;
  ReaderPool& readers_;
  KeyFile& receipts_key_;
  const Clock& clock_;
  const absl::Duration began_;  // on the monotonic clock
  std::atomic<int64_t> upload_names_ = 0;
  KnownArchives known_archives_{4096};

  // Answers that are told from stale ones by the store's count of changes.
  struct KeptBoard {
    int64_t changes = -1;
    std::shared_ptr<const std::string> text;
  };
  std::mutex mutex_;
  std::map<std::pair<std::string, std::string>, KeptBoard> boards_;  // by config and board; mutex_
};

}  // namespace myograde::server
