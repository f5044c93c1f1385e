// The API's resources, by noun: each function adds the addresses of its own. Handlers check
// requests, read the store on connections of their own, and hand changes to admission and the
// engine; they run on any thread. What is passed must outlive the server's last request. Included
// is what nearly all of them need.
#pragma once

#include <functional>
#include <type_traits>
#include <utility>

#include <absl/status/statusor.h>

#include "protocol/base/status_macros.h"
#include "server/api/caller.h"
#include "server/api/requests.h"
#include "server/api/routes.h"
#include "server/api/views.h"

namespace myograde::server {

// A handler with the context that it works on.
template <typename Result, typename... Arguments>
auto Bind(const ApiContext& context, Result (*handler)(const ApiContext&, Arguments...)) {
  return std::bind_front(handler, std::cref(context));
}
// The same for one that answers from one state of the store.
inline Routes::Handler Bind(const ApiContext& context,
                            ApiResult (*handler)(const ApiContext&, const Transaction&,
                                                 const Request&)) {
  return [&context, handler](const Request& request) {
    return context.readers.Read<ApiAnswer>(
        [&](const Transaction& reader) { return handler(context, reader, request); });
  };
}

template <typename T>
struct ValueOf {
  using Type = T;
};
template <typename T>
struct ValueOf<absl::StatusOr<T>> {
  using Type = T;
};

// The value that `body` makes of one state of the store.
template <typename Body>
auto ReadStore(const ApiContext& context, const Body& body) {
  using Value = typename ValueOf<std::invoke_result_t<Body, const Transaction&>>::Type;
  return context.readers.Read<Value>(body);
}
// The value that a change of the store gives, within a request's time.
template <typename Change>
auto ChangeStore(const ApiContext& context, Change change) {
  using Value = typename ValueOf<std::invoke_result_t<Change, Transaction&>>::Type;
  return context.engine.Change<Value>(std::move(change), context.config.http.request);
}

// Who the caller is, who may do what, and who did or tried what; bearer tokens.
void AddAccess(Routes& routes, const ApiContext& context);
// Teams: who belongs to them, their names, merging and banning them; what each may still submit.
void AddTeams(Routes& routes, const ApiContext& context);
// Uploads of archives; submissions, and the organiser's marks; evaluations, and reruns.
void AddSubmissions(Routes& routes, const ApiContext& context);
void AddEvaluations(Routes& routes, const ApiContext& context);
// Logs of episodes, trajectories, small pictures, and the shapes of the tracks' bodies.
void AddPictures(Routes& routes, const ApiContext& context);
// What waits and what is played, once or as a stream of events.
void AddQueue(Routes& routes, const ApiContext& context, Guard& guard);
// Leaderboards with their statistics; a board's submissions judged again under another config.
void AddBoards(Routes& routes, const ApiContext& context);
void AddRejudges(Routes& routes, const ApiContext& context);
// Phases and what organisers do with them; the reveal of their seeds, and further episodes for
// places that their own do not decide.
void AddChallenges(Routes& routes, const ApiContext& context);
void AddSeeds(Routes& routes, const ApiContext& context);
// Receipts and the key that signs them; the public record, its head and proofs.
void AddProof(Routes& routes, const ApiContext& context);
// The daemon's health, the tracks and runtimes that it has, the nodes of its cluster, its metrics.
void AddHost(Routes& routes, const ApiContext& context);
void AddMetrics(Routes& routes, const ApiContext& context);
// Export, import and backup of whole stores; webhooks.
void AddTransfer(Routes& routes, const ApiContext& context);
void AddWebhooks(Routes& routes, const ApiContext& context);
// The web pages, the documents, and the API's description.
void AddPages(Routes& routes, const ApiContext& context);
// Sends the page that says so to a browser that asked for one that there is not; false: it was no such request.
bool ServeUnknownPage(const Request& request, Response& response);

}  // namespace myograde::server
