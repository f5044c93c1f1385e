#include "sim/trajectory/recorder.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "sim/model/model.h"

namespace myograde::sim {
namespace {

using Json = nlohmann::json;

constexpr double kRangeSteps = 1e6;     // per unit: ranges are rounded outwards, so that heads are short
constexpr double kWeakestForce = 0.01;  // N
constexpr int kWrapChannels = 7;
constexpr int kContactChannels = 6;
constexpr int kContactBodies = 2;

constexpr float kUnknown = std::numeric_limits<float>::quiet_NaN();

// What all frames have of one kind, channel after channel instead of frame after frame.
std::vector<float> ByChannel(const std::vector<float>& by_frame, size_t channels) {
  std::vector<float> by_channel(by_frame.size());
  const size_t frames = channels == 0 ? 0 : by_frame.size() / channels;
  for (size_t f = 0; f < frames; ++f) {
    for (size_t c = 0; c < channels; ++c) by_channel[c * frames + f] = by_frame[f * channels + c];
  }
  return by_channel;
}

std::vector<ChannelRange> Ranges(const std::vector<float>& by_channel, size_t channels) {
  std::vector<ChannelRange> ranges;
  const size_t length = channels == 0 ? 0 : by_channel.size() / channels;
  for (size_t c = 0; c < channels; ++c) {
    ChannelRange range = RangeOf(std::span(by_channel).subspan(c * length, length));
    range.low = std::floor(range.low * kRangeSteps) / kRangeSteps;
    range.high = std::ceil(range.high * kRangeSteps) / kRangeSteps;
    ranges.push_back(range);
  }
  return ranges;
}

// With ranges of its own for each channel.
void AddRanged(ArrayBlock& arrays, std::string_view name, NumberType type,
               const std::vector<float>& by_frame, size_t channels) {
  const std::vector<float> values = ByChannel(by_frame, channels);
  arrays.Add(name, type, values, channels, Ranges(values, channels));
}

// Microseconds are enough, and short.
double Rounded(double seconds) { return std::round(seconds * 1e6) / 1e6; }

struct WorldContact {
  int index = 0;
  int on = 0, by = 0;     // bodies
  double strength = 0;    // N
  mjtNum force[3] = {};   // N, in the world
};

// A contact's force on the body that moves; if both do, on the later one.
WorldContact ForceOf(const mjModel& model, const mjData& data, int index) {
  const mjContact& contact = data.contact[index];
  mjtNum local[6];
  mj_contactForce(&model, &data, index, local);
  WorldContact out;
  out.index = index;
  // The rows of the frame are its axes; the first leads from the first geom to the second.
  mju_rotVecMatT(out.force, local, contact.frame);
  const int first = model.geom_bodyid[contact.geom1];
  const int second = model.geom_bodyid[contact.geom2];
  const bool on_second = model.body_weldid[second] != 0 &&
                         (model.body_weldid[first] == 0 || second > first);
  if (!on_second) mju_scl3(out.force, out.force, -1);
  out.on = on_second ? second : first;
  out.by = on_second ? first : second;
  out.strength = mju_norm3(out.force);
  return out;
}

std::vector<WorldContact> StrongestContacts(const mjModel& model, const mjData& data) {
  std::vector<WorldContact> contacts;
  for (int i = 0; i < data.ncon; ++i) {
    const WorldContact contact = ForceOf(model, data, i);
    if (contact.strength > kWeakestForce) contacts.push_back(contact);
  }
  std::stable_sort(contacts.begin(), contacts.end(),
                   [](const auto& a, const auto& b) { return a.strength > b.strength; });
  if (contacts.size() > kMostContacts) contacts.resize(kMostContacts);
  std::sort(contacts.begin(), contacts.end(),
            [](const auto& a, const auto& b) { return a.index < b.index; });
  return contacts;
}

// A point of the world in a body's frame.
void InBody(const mjData& data, int body, const mjtNum point[3], mjtNum local[3]) {
  mjtNum apart[3];
  mju_sub3(apart, point, data.xpos + 3 * body);
  mju_rotVecMatT(local, apart, data.xmat + 9 * body);
}

// Where the muscle of a path meets and leaves each shape that it wraps around now: for each of its
// wraps the index of the first of two entries of wrap_xpos, or -1.
std::vector<int> WrapEntries(const mjData& data, const MusclePath& muscle,
                             const std::vector<WrapShape>& wraps) {
  std::vector<int> entries;
  int at = data.ten_wrapadr[muscle.tendon];
  const int end = at + data.ten_wrapnum[muscle.tendon];
  for (const PathPoint& point : muscle.points) {
    if (point.wrap < 0) {
      ++at;
      continue;
    }
    const bool wrapped = at + 1 < end && data.wrap_obj[at] == wraps[point.wrap].geom;
    entries.push_back(wrapped ? at : -1);
    if (wrapped) at += 2;
  }
  return entries;
}

std::string FileOf(const Json& head, const std::string& arrays) {
  const std::string text = CanonicalJson(head);
  std::string file = kTrajectoryMagic;
  for (int shift = 0; shift < 32; shift += 8) {
    file.push_back(static_cast<char>((text.size() >> shift) & 0xFF));
  }
  return absl::StrCat(file, text, arrays);
}

}  // namespace

absl::StatusOr<std::unique_ptr<TrajectoryRecorder>> TrajectoryRecorder::Make(
    const Environment& environment, std::unique_ptr<Telemetry> telemetry,
    const RecordedEpisode& episode) {
  ASSIGN_OR_RETURN(Figure figure, BuildFigure(environment.model()));
  return std::unique_ptr<TrajectoryRecorder>(new TrajectoryRecorder(
      environment, std::move(telemetry), episode, std::move(figure)));
}

TrajectoryRecorder::TrajectoryRecorder(const Environment& environment,
                                       std::unique_ptr<Telemetry> telemetry,
                                       const RecordedEpisode& episode, Figure figure)
    : environment_(environment),
      telemetry_(std::move(telemetry)),
      episode_(episode),
      figure_(std::move(figure)),
      steps_per_frame_([&episode] {
        const auto each = static_cast<int64_t>(
            std::max(1.0, std::round(kFramePeriod / episode.control_period_s)));
        return each * (episode.steps / (each * (kMostFrames - 1)) + 1);
      }()),
      sample_(telemetry_->series().size()) {}

double TrajectoryRecorder::Now() const {
  return Rounded(static_cast<double>(steps_) * episode_.control_period_s);
}

void TrajectoryRecorder::Begin() {
  telemetry_->Begin();
  // What follows from the state may still be that of another one (the official environment's first
  // observation), so it is computed from a copy.
  const mjModel& model = environment_.model();
  const DataPtr now(mj_copyData(nullptr, &model, &environment_.data()));
  mj_forward(&model, now.get());
  Capture(*now);
}

void TrajectoryRecorder::AfterStep() {
  ++steps_;
  const size_t before = events_.size();
  telemetry_->AfterStep(Now(), events_);
  if (before >= kMostEvents) events_.resize(before);
  if (steps_ % steps_per_frame_ == 0) Capture(environment_.data());
}

void TrajectoryRecorder::Capture(const mjData& data) {
  CaptureParts(data);
  CaptureMuscles(data);
  CaptureContacts(data);
  telemetry_->Sample(sample_);
  series_.insert(series_.end(), sample_.begin(), sample_.end());
  ++frames_;
  captured_at_ = steps_;
}

void TrajectoryRecorder::CaptureParts(const mjData& data) {
  targets_ = telemetry_->Targets();
  for (size_t i = 0; i < figure_.parts.size(); ++i) {
    mjtNum position[3];
    mju_copy3(position, data.xpos + 3 * figure_.parts[i]);
    const int from = figure_.from[i];
    if (from >= 0) mju_subFrom3(position, data.xpos + 3 * figure_.parts[from]);
    CapturePose(position, data.xquat + 4 * figure_.parts[i]);
  }
  for (const TargetPose& target : targets_) {
    CapturePose(target.position.data(), target.rotation.data());
  }
}

void TrajectoryRecorder::CapturePose(const mjtNum position[3], const mjtNum rotation[4]) {
  positions_.insert(positions_.end(), position, position + 3);
  // A quaternion and its negative are the same rotation: the one that is nearer to the last.
  const size_t before = rotations_.size() - 4 * (figure_.parts.size() + targets_.size());
  double same = 0;
  for (size_t k = 0; k < 4 && frames_ > 0; ++k) same += rotation[k] * rotations_[before + k];
  for (int k = 0; k < 4; ++k) {
    rotations_.push_back(static_cast<float>(same < 0 ? -rotation[k] : rotation[k]));
  }
}

void TrajectoryRecorder::CaptureMuscles(const mjData& data) {
  for (const MusclePath& muscle : figure_.muscles) {
    activations_.push_back(static_cast<float>(data.act[muscle.activation]));
    size_t wrap = 0;
    const std::vector<int> entries = WrapEntries(data, muscle, figure_.wraps);
    for (const PathPoint& point : muscle.points) {
      if (point.wrap < 0) continue;
      const int entry = entries[wrap++];
      wraps_.push_back(entry < 0 ? 0 : 1);
      for (int end = 0; end < 2; ++end) {
        const int body = point.part < 0 ? 0 : figure_.parts[point.part];
        mjtNum local[3] = {kUnknown, kUnknown, kUnknown};
        if (entry >= 0) InBody(data, body, data.wrap_xpos + 3 * (entry + end), local);
        for (const mjtNum x : local) wraps_.push_back(static_cast<float>(x));
      }
    }
  }
}

void TrajectoryRecorder::CaptureContacts(const mjData& data) {
  const std::vector<WorldContact> contacts = StrongestContacts(environment_.model(), data);
  contact_counts_.push_back(static_cast<float>(contacts.size()));
  for (const WorldContact& contact : contacts) {
    for (const mjtNum x : data.contact[contact.index].pos) {
      contacts_.push_back(static_cast<float>(x));
    }
    for (const mjtNum x : contact.force) contacts_.push_back(static_cast<float>(x));
    for (const int body : {contact.on, contact.by}) {
      contact_bodies_.push_back(static_cast<float>(figure_.part_of[body] + 1));
    }
  }
}

absl::StatusOr<std::string> TrajectoryRecorder::Finish() {
  if (captured_at_ != steps_) Capture(environment_.data());
  telemetry_->AtEnd(Now(), events_);
  events_.push_back({Now(), "end", episode_.end});
  std::stable_sort(events_.begin(), events_.end(),
                   [](const auto& a, const auto& b) { return a.time_s < b.time_s; });
  ArrayBlock arrays;
  AddPoses(arrays);
  AddContacts(arrays);
  AddSeries(arrays);
  const Json terrain = AddTerrain(arrays);
  Json head = Head(arrays);
  if (!telemetry_->Legend().empty()) head["legend"] = telemetry_->Legend();
  head["terrain"] = terrain;
  std::string file = FileOf(head, arrays.bytes());
  if (file.size() <= kMostTrajectoryBytes) return file;
  return absl::ResourceExhaustedError(absl::StrCat(
      "the episode's trajectory has ", file.size(), " bytes, more than ", kMostTrajectoryBytes));
}

void TrajectoryRecorder::AddPoses(ArrayBlock& arrays) const {
  const size_t parts = figure_.parts.size() + targets_.size();
  AddRanged(arrays, "position", NumberType::kU16, positions_, 3 * parts);
  const ChannelRange unit[] = {{-1, 1}};
  arrays.Add("rotation", NumberType::kU16, ByChannel(rotations_, 4 * parts), 4 * parts, unit);
  const size_t muscles = figure_.muscles.size();
  const ChannelRange share[] = {{0, 1}};
  arrays.Add("activation", NumberType::kU8, ByChannel(activations_, muscles), muscles, share);
  const size_t channels = kWrapChannels * figure_.wraps.size();
  const std::vector<float> values = ByChannel(wraps_, channels);
  std::vector<ChannelRange> ranges = Ranges(values, channels);
  for (size_t c = 0; c < channels; c += kWrapChannels) ranges[c] = {0, 255};
  arrays.Add("wrap", NumberType::kU8, values, channels, ranges);
}

void TrajectoryRecorder::AddContacts(ArrayBlock& arrays) const {
  const ChannelRange whole[] = {{0, 255}};
  arrays.Add("contact_count", NumberType::kU8, contact_counts_, 1, whole);
  AddRanged(arrays, "contact", NumberType::kU16, contacts_, kContactChannels);
  const ChannelRange index[] = {{0, 65535}};
  arrays.Add("contact_body", NumberType::kU16, ByChannel(contact_bodies_, kContactBodies),
             kContactBodies, index);
}

void TrajectoryRecorder::AddSeries(ArrayBlock& arrays) const {
  const std::span<const Series> series = telemetry_->series();
  const std::vector<float> values = ByChannel(series_, series.size());
  std::vector<ChannelRange> ranges = Ranges(values, series.size());
  for (size_t i = 0; i < series.size(); ++i) {
    if (!series[i].labels.empty()) ranges[i] = {0, 65535};
  }
  arrays.Add("series", NumberType::kU16, values, series.size(), ranges);
}

Json TrajectoryRecorder::AddTerrain(ArrayBlock& arrays) const {
  const mjModel& model = environment_.model();
  for (int geom = 0; geom < model.ngeom; ++geom) {
    if (model.geom_type[geom] != mjGEOM_HFIELD) continue;
    const int field = model.geom_dataid[geom];
    const auto rows = static_cast<size_t>(model.hfield_nrow[field]);
    const auto columns = static_cast<size_t>(model.hfield_ncol[field]);
    const mjtNum* size = model.hfield_size + 4 * field;
    const mjtNum* place = model.geom_pos + 3 * geom;
    std::vector<float> heights(rows * columns);
    const float* samples = model.hfield_data + model.hfield_adr[field];
    for (size_t i = 0; i < heights.size(); ++i) {
      heights[i] = static_cast<float>(place[2] + samples[i] * size[2]);
    }
    const ChannelRange range[] = {Ranges(heights, 1).front()};
    arrays.Add("terrain", NumberType::kU16, heights, rows, range);
    return {{"rows", rows},
            {"columns", columns},
            {"low", {place[0] - size[0], place[1] - size[1]}},
            {"high", {place[0] + size[0], place[1] + size[1]}}};
  }
  return nullptr;
}

Json TrajectoryRecorder::PartsToJson() const {
  Json parts = Json::array();
  const auto add = [&](int body) -> Json& {
    Json part = {{"name", mj_id2name(&environment_.model(), mjOBJ_BODY, body)}};
    const std::array<double, 3> scale = telemetry_->ScaleOf(body);
    if (scale != std::array<double, 3>{1, 1, 1}) part["scale"] = scale;
    return parts.emplace_back(std::move(part));
  };
  for (size_t i = 0; i < figure_.parts.size(); ++i) {
    Json& part = add(figure_.parts[i]);
    if (figure_.from[i] >= 0) part["from"] = figure_.from[i];
  }
  for (const TargetPose& target : targets_) add(target.body)["target"] = true;
  return parts;
}

Json TrajectoryRecorder::EventsToJson() const {
  Json list = Json::array();
  for (const TrajectoryEvent& event : events_) {
    Json entry = {{"time_s", event.time_s}, {"kind", event.kind}, {"text", event.text}};
    if (event.value.has_value() && std::isfinite(*event.value)) {
      entry["value"] = *event.value;
      entry["unit"] = event.unit;
    }
    list.push_back(std::move(entry));
  }
  return list;
}

Json TrajectoryRecorder::SeriesToJson() const {
  Json list = Json::array();
  for (const Series& series : telemetry_->series()) {
    Json entry = {{"name", series.name}, {"title", series.title}, {"unit", series.unit}};
    for (const std::string_view label : series.labels) entry["labels"].push_back(label);
    if (!series.graph.empty()) entry["graph"] = series.graph;
    const double tolerance = telemetry_->ToleranceOf(series.name);
    if (tolerance > 0) entry["tolerance"] = tolerance;
    list.push_back(std::move(entry));
  }
  return list;
}

Json TrajectoryRecorder::Head(const ArrayBlock& arrays) const {
  Json muscles = Json::array();
  for (const MusclePath& muscle : figure_.muscles) muscles.push_back(muscle.name);
  const double period = static_cast<double>(steps_per_frame_) * episode_.control_period_s;
  return {{"format", 1},
          {"track", episode_.track},
          {"model", episode_.model},
          {"episode", episode_.episode},
          {"end", episode_.end},
          {"steps", steps_},
          {"duration_s", Now()},
          {"period_s", Rounded(period)},
          {"frames", frames_},
          {"bodies", PartsToJson()},
          {"muscles", std::move(muscles)},
          {"wraps", figure_.wraps.size()},
          {"series", SeriesToJson()},
          {"events", EventsToJson()},
          {"arrays", arrays.head()}};
}

}  // namespace myograde::sim
