#include "server/metrics/metrics.h"

#include <gmock/gmock.h>

#include <thread>

#include "server/metrics/disk_space.h"

namespace myograde::server {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

TEST(MetricsTest, CountsAppearWithTheirLabels) {
  Metrics metrics;
  metrics.CountEpisode("track", "crash", /*participant_fault=*/true);
  metrics.CountEpisode("track", "success", /*participant_fault=*/false);
  metrics.ObserveLease("track", absl::Seconds(20));
  metrics.ObserveStoreWrite(absl::Milliseconds(2), /*ok=*/false);
  const std::string text = MetricsText(metrics.Collect());
  EXPECT_THAT(text, HasSubstr("# TYPE myograde_episodes_total counter\n"));
  EXPECT_THAT(text, HasSubstr("outcome=\"crash\""));
  EXPECT_THAT(text, HasSubstr("myograde_participant_faults_total{kind=\"crash\"} 1\n"));
  EXPECT_THAT(text, Not(HasSubstr("kind=\"success\"")));
  EXPECT_THAT(text, HasSubstr("myograde_lease_duration_seconds_bucket{track=\"track\",le=\"30\"} 1\n"));
  EXPECT_THAT(text, HasSubstr("myograde_lease_duration_seconds_bucket{track=\"track\",le=\"15\"} 0\n"));
  EXPECT_THAT(text, HasSubstr("myograde_store_write_failures_total 1\n"));
}

TEST(MetricsTest, ReasonsFromOutsideAreNoLabels) {
  Metrics metrics;
  metrics.CountDenial("role");
  for (int i = 0; i < 1000; ++i) metrics.CountDenial("reason " + std::to_string(i));
  const std::string text = MetricsText(metrics.Collect());
  EXPECT_THAT(text, HasSubstr("myograde_denials_total{reason=\"role\"} 1\n"));
  EXPECT_THAT(text, HasSubstr("myograde_denials_total{reason=\"other\"} 1000\n"));
}

TEST(MetricsTest, TextEscapesLabelsAndSortsFamilies) {
  std::vector<MetricFamily> families;
  AddGauges<int>(families, "b", "second", "name", {{"x\"} 1\n\\", 2}});
  AddGauges<double>(families, "a", "first", "", {{"", 0.5}});
  EXPECT_EQ(MetricsText(families),
            "# HELP a first\n# TYPE a gauge\na 0.5\n"
            "# HELP b second\n# TYPE b gauge\nb{name=\"x\\\"} 1\\n\\\\\"} 2\n");
}

TEST(MetricsTest, ThreadsCountTogether) {
  Metrics metrics;
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i) {
    threads.emplace_back([&] {
      for (int n = 0; n < 500; ++n) metrics.CountGraderFault("start");
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_THAT(MetricsText(metrics.Collect()),
              HasSubstr("myograde_grader_faults_total{kind=\"start\"} 2000\n"));
}

TEST(DiskSpaceTest, PartsFitTogether) {
  const std::optional<DiskSpace> disk = DiskSpaceAt("/");
  ASSERT_TRUE(disk.has_value());
  EXPECT_GT(disk->size, 0);
  EXPECT_LE(disk->used + disk->free, disk->size);
  EXPECT_FALSE(DiskSpaceAt("/nonexistent").has_value());
}

}  // namespace
}  // namespace myograde::server
