// The HTTP API (README.md): a class for each resource, over a shared context. They check requests,
// read the store on connections of their own, and hand changes to admission and the engine.
#pragma once

#include "server/api/access_resource.h"
#include "server/api/artefacts_resource.h"
#include "server/api/boards_resource.h"
#include "server/api/challenges_resource.h"
#include "server/api/context.h"
#include "server/api/evaluations_resource.h"
#include "server/api/guard.h"
#include "server/api/host_resource.h"
#include "server/api/lease_resource.h"
#include "server/api/more_seeds_resource.h"
#include "server/api/metrics_resource.h"
#include "server/api/nodes_resource.h"
#include "server/api/openapi_resource.h"
#include "server/api/pages_resource.h"
#include "server/api/pictures_resource.h"
#include "server/api/proof_resource.h"
#include "server/api/queue_resource.h"
#include "server/api/quota_resource.h"
#include "server/api/record_resource.h"
#include "server/api/rejudges_resource.h"
#include "server/api/reveal_resource.h"
#include "server/api/runtimes_resource.h"
#include "server/api/statistics_resource.h"
#include "server/api/submissions_resource.h"
#include "server/api/teams_resource.h"
#include "server/api/tokens_resource.h"
#include "server/api/transfer_resource.h"
#include "server/api/unix_http_server.h"
#include "server/api/webhooks_resource.h"
#include "server/api/whoami_resource.h"

namespace myograde::server {

class Api {
 public:
  explicit Api(const ApiContext& context);
  Api(const Api&) = delete;
  Api& operator=(const Api&) = delete;

  // Adds every address of the API to `server`, which must not outlive it.
  void Install(UnixHttpServer& server);

 private:
  const ApiContext context_;
  Guard guard_;
  AccessResource access_{context_};
  HostResource host_{context_};
  LeaseResource leases_{context_.leases};
  MetricsResource metrics_{context_};
  ArtefactsResource artefacts_{context_};
  SubmissionsResource submissions_{context_};
  EvaluationsResource evaluations_{context_};
  KeptStatistics kept_statistics_;
  BoardsResource boards_{context_, kept_statistics_};
  ChallengesResource challenges_{context_};
  NodesResource nodes_{context_};
  QuotaResource quota_{context_};
  PicturesResource pictures_{context_};
  ProofResource proof_{context_};
  RecordResource record_{context_};
  RejudgesResource rejudges_{context_};
  RevealResource reveal_{context_};
  RuntimesResource runtimes_{context_};
  StatisticsResource statistics_{context_, kept_statistics_};
  MoreSeedsResource more_seeds_{context_};
  TeamsResource teams_{context_};
  TokensResource tokens_{context_};
  TransferResource transfer_{context_};
  WebhooksResource webhooks_{context_};
  WhoamiResource whoami_{context_};
  OpenApiResource openapi_;
  QueueResource queue_{context_, guard_};
  PagesResource pages_{context_.documents};
};

}  // namespace myograde::server
