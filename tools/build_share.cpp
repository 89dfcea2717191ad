#include "tools/build_share.h"

#include <algorithm>
#include <array>
#include <string_view>

#include "tools/tool.h"

namespace splatvol {
namespace {

// Stages in their order, and how long they take, as measured on builds that keep cells and boundary: of meshes from
// 2e5 to 4e6 cells, of 1e6 points that Delaunay tetrahedra join, and of 2e6 points by their Voronoi cells. Stages that
// a build leaves out make it a little faster.
struct Stage {
  std::string_view name;
  std::array<double, 3> times;  // [BuildKind]: percent of the build
};
constexpr std::array<Stage, 10> stages = {{{"reading", {46, 2, 4}},
                                           {"connecting", {1, 62, 5}},
                                           {"reducing", {9, 18, 85}},
                                           {"indexing", {3, 4, 1}},
                                           {"simplifying the boundary", {1, 0.5, 0.5}},
                                           {"sorting cells", {5, 1, 0.5}},
                                           {"writing", {1, 0.5, 1}},
                                           {"writing cells", {7, 3, 0.5}},
                                           {"summarizing cells", {1, 0.5, 0.5}},
                                           {"checking", {6, 3, 2}}}};

// The time in which the reader process reads, of the time of the stage "reading". The rest is for points and cells.
constexpr double reader_share = 0.25;

// Before, nobody knows how long the rest will take.
constexpr double least_known_share = 0.02, least_known_seconds = 0.5;

// The time of the first stages.
double time_of(std::size_t count, BuildKind kind) {
  double sum = 0;
  for (std::size_t i = 0; i < count; ++i) sum += stages[i].times[static_cast<std::size_t>(kind)];
  return sum;
}

}  // namespace

BuildShare::BuildShare() : start_(seconds_now()) {}

void BuildShare::set_kind(BuildKind kind) {
  const std::lock_guard lock(mutex_);
  kind_ = kind;
}

void BuildShare::set_steps(std::size_t steps) {
  const std::lock_guard lock(mutex_);
  steps_ = std::max<std::size_t>(steps, 1);
  opened_ = group_end_ = 0;
}

void BuildShare::open_step(std::size_t step) {
  const std::lock_guard lock(mutex_);
  opened_ = std::max(opened_, step + 1);
}

void BuildShare::read(double share) {
  const std::lock_guard lock(mutex_);
  bytes_ = std::max(bytes_, share);
  has_reader_ = true;
  raise_share();
}

void BuildShare::update(const std::string& stage, double fraction) {
  const std::lock_guard lock(mutex_);
  const auto found = std::ranges::find(stages, stage, &Stage::name);
  if (found == stages.end()) return;
  const auto place = static_cast<std::size_t>(found - stages.begin());
  if (place < place_) done_ = group_end_;  // the next group
  group_end_ = std::max(opened_, done_);
  place_ = place;
  stage_ = stage;
  fraction_ = fraction;
  raise_share();
}

BuildShare::State BuildShare::state() const {
  const std::lock_guard lock(mutex_);
  const double seconds = seconds_now() - start_;
  const bool is_known = share_ > least_known_share && seconds > least_known_seconds;
  return {stage_, share_, is_known ? std::optional(seconds * (1 - share_) / share_) : std::nullopt};
}

void BuildShare::raise_share() {
  // How much of its input one of several steps is, nobody knows.
  const bool by_bytes = has_reader_ && steps_ == 1 && place_ == 0;
  const double of_stage = by_bytes ? reader_share * bytes_ + (1 - reader_share) * fraction_ : fraction_;
  const double before = time_of(place_, kind_), after = time_of(place_ + 1, kind_);
  const double of_group = (before + (after - before) * of_stage) / time_of(stages.size(), kind_);
  const double steps = static_cast<double>(done_) + static_cast<double>(group_end_ - done_) * of_group;
  share_ = std::clamp(steps / static_cast<double>(steps_), share_, 1.0);
}

}  // namespace splatvol
