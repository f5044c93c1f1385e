#include "server/api/api.h"

#include "server/api/resources.h"
#include "server/api/routes.h"

namespace myograde::server {

Api::Api(const ApiContext& context, HttpServer& server) : context_(context), guard_(context_) {
  const Router& router = server.router();
  server.SetHooks(
      {.is_organiser =
           [this](const Peer& peer) { return IsOrganiser(peer, context_.config.access); },
       .admit = [this, &router](Connection& from) { return guard_.AdmitBody(from, router); },
       .count_refusal = [this](int http) { context_.metrics.CountRefusal(http); }});
  Routes routes(server.router(), guard_, context_);
  AddAccess(routes, context_);
  AddTeams(routes, context_);
  AddSubmissions(routes, context_);
  AddEvaluations(routes, context_);
  AddPictures(routes, context_);
  AddQueue(routes, context_, guard_);
  AddBoards(routes, context_);
  AddRejudges(routes, context_);
  AddChallenges(routes, context_);
  AddSeeds(routes, context_);
  AddProof(routes, context_);
  AddHost(routes, context_);
  AddMetrics(routes, context_);
  AddTransfer(routes, context_);
  AddWebhooks(routes, context_);
  AddPages(routes, context_);
}

}  // namespace myograde::server
