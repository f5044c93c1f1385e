#include "server/api/api.h"

#include "server/api/routes.h"

namespace myograde::server {

Api::Api(const ApiContext& context)
    : context_(context),
      guard_({.access = context_.config.access,
              .limits = context_.config.http,
              .readers = context_.readers,
              .log = context_.access_log,
              .clock = context_.clock,
              .challenge = context_.challenge,
              .metrics_token = context_.metrics_token,
              .leases = context_.leases}) {}

void Api::Install(UnixHttpServer& server) {
  server.SetOrganisers(
      [this](const Peer& peer) { return IsOrganiser(peer, context_.config.access); });
  server.SetAdmit([this, &router = server.router()](Connection& connection) {
    return guard_.AdmitBody(connection, router);
  });
  server.SetRefusalCounter([this](int http) { context_.metrics.CountRefusal(http); });
  Routes routes(server.router(), guard_, context_.metrics);
  access_.Install(routes);
  host_.Install(routes);
  leases_.Install(routes);
  metrics_.Install(routes);
  artefacts_.Install(routes);
  submissions_.Install(routes);
  evaluations_.Install(routes);
  boards_.Install(routes);
  challenges_.Install(routes);
  quota_.Install(routes);
  nodes_.Install(routes);
  pictures_.Install(routes);
  proof_.Install(routes);
  record_.Install(routes);
  rejudges_.Install(routes);
  reveal_.Install(routes);
  runtimes_.Install(routes);
  statistics_.Install(routes);
  more_seeds_.Install(routes);
  teams_.Install(routes);
  tokens_.Install(routes);
  transfer_.Install(routes);
  webhooks_.Install(routes);
  whoami_.Install(routes);
  openapi_.Install(routes);
  queue_.Install(routes);
  pages_.Install(routes);
}

}  // namespace myograde::server
