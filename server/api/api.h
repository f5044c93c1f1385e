// The HTTP API (README.md): requests are checked here, read from the store on
// connections of their own, and handed to the engine where they change something.
#pragma once

#include <atomic>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <string>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "protocol/base/clock.h"
#include "server/api/unix_http_server.h"
#include "server/daemon/engine.h"

namespace myograde::server {

// An answer other than 200 with a body.
struct ApiError {
  int http = 500;
  std::string code;
  std::string message;
};

// The answer to a status of the store, the engine or a check.
ApiError ErrorOf(const absl::Status& status);

class Api {
 public:
  struct Options {
    ServerConfig config;
    std::string data_dir;
    absl::Time started_at;
  };

  // All must outlive the server that Install is called on.
  Api(Options options, const Tracks& tracks, Engine& engine, ReaderPool& readers,
      const Clock& clock);

  // Adds every address of the API to `server`.
  void Install(UnixHttpServer& server);

 private:
  using Json = nlohmann::json;
  using Request = httplib::Request;
  struct Answer {
    int http = 200;
    Json body;
  };
  using Result = std::variant<Answer, ApiError>;

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
  Result Submit(const Request& request, const Json& body);
  Result Cancel(const Request& request, const Json& body);
  Result Rerun(const Request& request, const Json& body);
  Result Upload(const Request& request, const httplib::ContentReader& content);

  absl::StatusOr<Json> Status(Reader& reader, int64_t submission);
  absl::StatusOr<Json> Breakdown(Reader& reader, int64_t evaluation, bool episodes);
  absl::StatusOr<scoring::Aggregate> FinalAggregate(Reader& reader, int64_t evaluation);
  Result EvaluationAnswer(int64_t evaluation, bool of_submission, const Request& request);
  absl::StatusOr<ArtefactRow> Receive(const httplib::ContentReader& content, bool& is_new);

  const Options options_;
  const Tracks& tracks_;
  Engine& engine_;
  ReaderPool& readers_;
  const Clock& clock_;
  std::atomic<int> uploads_ = 0;
  std::atomic<int64_t> upload_names_ = 0;

  std::mutex mutex_;
  // Of evaluations that have ended, so it never goes stale. Guarded by mutex_.
  std::map<int64_t, scoring::Aggregate> aggregates_;
};

}  // namespace myograde::server
