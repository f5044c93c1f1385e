// GET /metrics: what the daemon counted, and what its state is at the moment, for Prometheus.
#pragma once

#include <optional>
#include <vector>

#include "server/api/context.h"
#include "server/api/routes.h"
#include "server/metrics/metrics.h"

namespace myograde::server {

// Safe from any thread.
class MetricsResource {
 public:
  // `context` must outlive it.
  explicit MetricsResource(const ApiContext& context) : context_(context) {}

  void Install(Routes& routes);

 private:
  absl::Status Get(const Request& request, Response& response) const;
  void AddEngine(const LiveHealth& health, std::vector<MetricFamily>& families) const;
  void AddHost(const LiveHealth& health, std::vector<MetricFamily>& families) const;
  // Its jobs and nodes.
  void AddCluster(std::vector<MetricFamily>& families) const;
  void AddDisks(std::vector<MetricFamily>& families) const;
  // What only a reading of the store tells; without it where the store can't be read.
  void AddStore(std::vector<MetricFamily>& families) const;
  void AddWebhooks(Reader& reader, std::vector<MetricFamily>& families) const;

  const ApiContext& context_;
};

}  // namespace myograde::server
