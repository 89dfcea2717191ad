#include "player/scene_streamlines.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <string>
#include <thread>
#include <tuple>
#include <utility>

#include "renderer/surfaces/tubes.h"

namespace splatvol {
namespace {

constexpr double thinned_share = 0.1;            // of the radius
constexpr double fewest_colors = 256;            // along all values of the lines
constexpr std::chrono::milliseconds pause{150};  // at least, between two calls of TakeTubes
constexpr int pause_factor = 4;                  // likewise, times what the first of them took

// The attribute that colours tubes; none: the vector's first component, which is not used.
std::string attribute_of(const SceneStreamlines& one) {
  return one.color_by ? one.color_by->attribute : one.vector + "[0]";
}

bool have_same_field(const SceneTubes& before, const SceneStreamlines& one, const StreamlineFile& file) {
  return before.field && before.file->volume->name() == file.volume->name() && before.file->memory == file.memory &&
         before.step_key == file.volume->step_key() && before.of.vector == one.vector &&
         attribute_of(before.of) == attribute_of(one);
}

bool have_same_lines(const SceneTubes& before, const SceneStreamlines& one, const StreamlineFile& file) {
  return before.lines && have_same_field(before, one, file) && before.of.seeds == one.seeds &&
         before.of.direction == one.direction && before.of.max_length == one.max_length &&
         before.of.max_steps == one.max_steps;
}

// How far values may be off between rows.
double difference_of(const std::vector<Streamline>& lines) {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (const Streamline& line : lines)
    for (const double value : line.values[0]) low = std::fmin(low, value), high = std::fmax(high, value);
  return std::max((high - low) / fewest_colors, std::numeric_limits<double>::min());
}

Status make_tubes(const std::string& file, SceneTubes& tubes) {
  const SceneStreamlines& of = tubes.of;
  TubeMesh made;
  const double difference = difference_of(*tubes.lines);
  for (const Streamline& line : *tubes.lines) {
    const std::span<const double> values = of.color_by ? std::span(line.values[0]) : std::span<const double>();
    const auto rows = thinned(line.positions, values, thinned_share * of.radius, difference);
    SPLATVOL_TRY(add_tube(line.positions, values, rows, of.radius, made));
  }
  tubes.surface.style = {.file = "streamlines of " + of.vector, .color = of.color, .color_by = of.color_by};
  tubes.surface.mesh = std::make_shared<const TriangleMesh>(std::move(made.mesh));
  if (of.color_by)
    tubes.surface.values =
        std::make_shared<const SurfaceValues>(of.color_by->attribute, file, tubes.step_key, std::move(made.values));
  return {};
}

// Follows streamlines of a scene one after the other.
class Following {
 public:
  Following(const StreamlineFile& file, std::span<const SceneTubes> before, const TakeTubes& take)
      : file_(std::make_shared<const StreamlineFile>(file)), before_(before), take_(take) {}

  [[nodiscard]] Status follow(const SceneStreamlines& one) {
    SceneTubes& tubes = all_.emplace_back();
    tubes.of = one;
    tubes.step_key = file_->volume->step_key();
    tubes.surface.style.shown = false;
    if (!one.shown) return {};
    const auto same =
        std::ranges::find_if(before_, [&](const SceneTubes& before) { return have_same_lines(before, one, *file_); });
    if (same == before_.end()) return follow_lines();
    std::tie(tubes.lines, tubes.seeds, tubes.file, tubes.field) =
        std::tie(same->lines, same->seeds, same->file, same->field);
    return make_tubes(file_->volume->name(), tubes);
  }

  [[nodiscard]] std::vector<SceneTubes> tubes() && { return std::move(all_); }

 private:
  // Follows those of the last one.
  Status follow_lines() {
    SceneTubes& tubes = all_.back();
    const format::Volume& volume = *file_->volume;
    SPLATVOL_TRY(open_field(tubes));
    SPLATVOL_TRY_ASSIGN(seeds, positions_of(tubes.of.seeds, volume, file_->memory->patches.capacity()));
    StreamlineRequest request;
    request.direction = tubes.of.direction;
    request.max_length = tubes.of.max_length;
    request.max_steps = tubes.of.max_steps;
    SPLATVOL_TRY_ASSIGN(limits, limits_of(request, volume));
    tubes.seeds = seeds.size();
    std::vector<Streamline> lines, without_rows;
    Status made;
    auto next = std::chrono::steady_clock::now();  // the first comes at once
    const std::size_t threads = std::max(1u, std::thread::hardware_concurrency());
    SPLATVOL_TRY(follow_streamlines(*tubes.field, seeds, limits, threads, [&](Streamline line) {
      (line.positions.empty() ? without_rows : lines).push_back(std::move(line));
      const auto now = std::chrono::steady_clock::now();
      if (!take_ || lines.empty() || now < next || !made) return;
      made = show(lines, tubes);
      take_(all_);
      const auto end = std::chrono::steady_clock::now();
      next = end + std::max<std::chrono::steady_clock::duration>(pause, pause_factor * (end - now));
    }));
    SPLATVOL_TRY(made);
    if (lines.empty()) return fail_without_lines(volume, without_rows);
    return show(std::move(lines), tubes);
  }

  [[nodiscard]] Status open_field(SceneTubes& tubes) const {
    const auto same = std::ranges::find_if(
        before_, [&](const SceneTubes& before) { return have_same_field(before, tubes.of, *file_); });
    if (same != before_.end()) {
      tubes.file = same->file;
      tubes.field = same->field;
      return {};
    }
    SPLATVOL_TRY_ASSIGN(field, VectorField::open(*file_->volume, tubes.of.vector, {attribute_of(tubes.of)},
                                                 file_->room.in(file_->memory->streamlines)));
    tubes.file = file_;
    tubes.field = std::move(field);
    return {};
  }

  // In the order of the seeds, so that pictures do not depend on threads.
  [[nodiscard]] Status show(std::vector<Streamline> lines, SceneTubes& tubes) const {
    std::ranges::sort(lines, {}, &Streamline::seed);
    tubes.lines = std::make_shared<const std::vector<Streamline>>(std::move(lines));
    return make_tubes(file_->volume->name(), tubes);
  }

  std::shared_ptr<const StreamlineFile> file_;
  std::span<const SceneTubes> before_;
  const TakeTubes& take_;
  std::vector<SceneTubes> all_;
};

}  // namespace

Result<std::vector<SceneTubes>> read_scene_streamlines(std::span<const SceneStreamlines> streamlines,
                                                       const StreamlineFile& file, std::span<const SceneTubes> before,
                                                       const TakeTubes& take) {
  Following following(file, before, take);
  for (const SceneStreamlines& one : streamlines) SPLATVOL_TRY(following.follow(one));
  return std::move(following).tubes();
}

}  // namespace splatvol
