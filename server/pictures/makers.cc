#include "server/pictures/makers.h"

#include <filesystem>
#include <system_error>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/clock.h"
#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/render_order.h"
#include "protocol/lease/sim_channel.h"
#include "server/base/program_run.h"
#include "server/proof/replay_run.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

constexpr int kPictureNice = 19;
constexpr int kWidth = 320, kHeight = 180;  // pixels
constexpr size_t kMostPictureBytes = 1 << 20;
constexpr absl::Duration kPictureTime = absl::Minutes(10);
constexpr absl::Duration kTimePerLog = absl::Minutes(1);  // that a picture plays first
// Of the longest lease whose state carries over, on processors that all grade.
constexpr absl::Duration kTrajectoryTime = absl::Minutes(30);

// An empty folder that is gone with its owner.
class WorkFolder {
 public:
  static absl::StatusOr<WorkFolder> Make(const std::string& path) {
    std::error_code error;
    fs::remove_all(path, error);
    if (!error) fs::create_directories(path, error);
    if (!error) fs::permissions(path, fs::perms::owner_all, error);
    if (error) {
      return absl::InternalError(absl::StrCat(path, ": can't be made: ", error.message()));
    }
    return WorkFolder(path);
  }
  WorkFolder(WorkFolder&& other) noexcept : path_(std::exchange(other.path_, "")) {}
  WorkFolder& operator=(WorkFolder&&) = delete;
  ~WorkFolder() {
    std::error_code ignored;
    if (!path_.empty()) fs::remove_all(path_, ignored);
  }

 private:
  explicit WorkFolder(std::string path) : path_(std::move(path)) {}
  std::string path_;
};

// The first sentence of what a program printed as its reason.
std::string ReasonOf(const ProgramEnd& end, const std::string& program) {
  std::string text = end.errors;
  while (!text.empty() && text.back() == '\n') text.pop_back();
  const std::string own = program + ": ";
  if (text.starts_with(own)) text.erase(0, own.size());
  if (!text.empty()) return text;
  return absl::StrCat(program, " ended with status ", end.exit_status, " and no reason");
}

}  // namespace

absl::StatusOr<std::string> MakeTrajectory(const PicturedEpisode& episode,
                                           const MakerOptions& options, const Stopped& stopped) {
  ASSIGN_OR_RETURN(const WorkFolder folder, WorkFolder::Make(options.work_dir));
  const std::string file = options.work_dir + "/trajectory";
  ReplayOrder order;
  order.track = episode.track;
  order.blocks = {{episode.episodes, episode.logs, file}};
  order.work_dir = options.work_dir;
  order.cache_dir = options.cache_dir;
  order.uid_base = options.uid;
  order.background = true;
  const Deadline deadline(kTrajectoryTime);
  const absl::StatusOr<std::vector<ReplayRecord>> records =
      RunReplay(order, {.progress = [](int64_t, int64_t) {},
                        .stopped = [&] { return stopped() || deadline.over(); }});
  if (absl::IsCancelled(records.status()) && !stopped()) {
    return absl::DeadlineExceededError(absl::StrCat("the episode was not played after ",
                                                    absl::FormatDuration(kTrajectoryTime)));
  }
  if (!records.ok()) return records.status();
  if (records->empty() || !records->back().equal) {
    return absl::DataLossError(absl::StrCat(
        "this build of the grader does not play the episode as it was recorded: ",
        records->empty() ? "nothing was played" : records->back().detail));
  }
  absl::StatusOr<std::string> bytes = ReadFile(file, kMostTrajectoryFileBytes);
  if (!bytes.ok()) return absl::InternalError(bytes.status().message());
  return bytes;
}

absl::StatusOr<std::string> MakePicture(const PicturedEpisode& episode, const MakerOptions& options,
                                        const Stopped& stopped) {
  const absl::Duration time = kPictureTime + static_cast<double>(episode.logs.size() - 1) * kTimePerLog;
  RenderOrder order;
  order.track = episode.track;
  order.cache_dir = options.cache_dir;
  order.episodes = {{.logs = episode.logs, .title = "", .verdict = ""}};
  order.form = RenderOrder::Form::kPicture;
  order.width = kWidth;
  order.height = kHeight;
  order.overlay = false;
  order.deadline_s = absl::ToDoubleSeconds(time);
  ASSIGN_OR_RETURN(const ProgramEnd end, RunProgram({.program = "myograde-render",
                                                     .words = {},
                                                     .input = RenderOrderToJson(order).dump(),
                                                     .most_output = kMostPictureBytes,
                                                     .deadline = time,
                                                     .nice = kPictureNice},
                                                    stopped));
  if (end.exit_status == kRendered) return end.output;
  const std::string why = ReasonOf(end, "myograde-render");
  return end.exit_status == kRenderLogFault ? absl::DataLossError(why) : absl::InternalError(why);
}

absl::StatusOr<std::string> MakeModel(const std::string& track, const MakerOptions& options,
                                      const Stopped& stopped) {
  ASSIGN_OR_RETURN(const WorkFolder folder, WorkFolder::Make(options.work_dir));
  const std::string file = options.work_dir + "/model.glb";
  ASSIGN_OR_RETURN(const ProgramEnd end, RunProgram({.program = "myograde-sim",
                  .words = {"--model-file", track, file, options.cache_dir},
                  .input = "",
                  .most_output = 0,
                  .deadline = kPictureTime,
                  .nice = kPictureNice},
                 stopped));
  if (end.exit_status != 0) return absl::InternalError(ReasonOf(end, "myograde-sim"));
  absl::StatusOr<std::string> bytes = ReadFile(file);
  if (!bytes.ok()) return absl::InternalError(bytes.status().message());
  return bytes;
}

}  // namespace myograde::server
