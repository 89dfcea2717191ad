#include "player/scene_streamlines.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <string>
#include <thread>
#include <tuple>
#include <utility>

#include "player/scene_surfaces.h"
#include "renderer/surfaces/tubes.h"

namespace splatvol {
namespace {

constexpr double thinned_share = 0.1;            // of the radius
constexpr double fewest_colors = 256;            // along all values of the lines
constexpr std::chrono::milliseconds pause{150};  // at least, between two calls of TakeTubes
constexpr int pause_factor = 4;                  // likewise, times what the first of them took

// Shares of the memory of streamlines. There is room for those that are shown, those that are made, and twice for some
// of them: on their way, and to be shown next.
constexpr double share_of_all = 0.35;    // lines and tubes of a scene
constexpr double share_of_some = 0.087;  // while lines are followed

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

std::uint64_t bytes_of(std::span<const Streamline> lines) {
  std::uint64_t bytes = 0;
  for (const Streamline& line : lines) {
    bytes += sizeof(Streamline) + line.positions.capacity() * sizeof(dvec3) + line.times.capacity() * sizeof(double);
    for (const std::vector<double>& values : line.values) bytes += sizeof(values) + values.capacity() * sizeof(double);
  }
  return bytes;
}

// Makes the tubes of lines. Returns false, and makes none, if lines and tubes take more than `most` bytes or if `share`
// has no room for them.
Result<bool> make_tubes(const std::string& file, std::uint64_t most, MemoryShare& share, SceneTubes& tubes) {
  const SceneStreamlines& of = tubes.of;
  const double difference = difference_of(*tubes.lines);
  const auto values_of = [&](const Streamline& line) {
    return of.color_by ? std::span(line.values[0]) : std::span<const double>();
  };
  std::vector<std::vector<std::size_t>> rows;  // [line]
  std::size_t points = 0;
  for (const Streamline& line : *tubes.lines) {
    rows.push_back(thinned(line.positions, values_of(line), thinned_share * of.radius, difference));
    points += tube_points(line.positions, rows.back());
  }
  const std::uint64_t bytes = bytes_of(*tubes.lines) + drawn_bytes(points, 2 * points);
  auto room = bytes <= most ? share.reserve(bytes) : std::nullopt;
  if (!room) return false;
  TubeMesh made;
  made.mesh.points.reserve(points);
  made.mesh.triangles.reserve(2 * points);
  if (of.color_by) made.values.reserve(points);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Streamline& line = (*tubes.lines)[i];
    SPLATVOL_TRY(add_tube(line.positions, values_of(line), rows[i], of.radius, made));
  }
  tubes.room = std::make_shared<const Reservation>(*std::move(room));
  tubes.surface.style = {.file = "streamlines of " + of.vector, .color = of.color, .color_by = of.color_by};
  tubes.surface.mesh = std::make_shared<const TriangleMesh>(std::move(made.mesh));
  if (of.color_by)
    tubes.surface.values =
        std::make_shared<const SurfaceValues>(of.color_by->attribute, file, tubes.step_key, std::move(made.values));
  return true;
}

// Follows streamlines of a scene one after the other.
class Following {
 public:
  Following(const StreamlineFile& file, std::span<const SceneTubes> before, const TakeTubes& take)
      : file_(std::make_shared<const StreamlineFile>(file)),
        before_(before),
        take_(take),
        left_(share_of(share_of_all)) {}

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
    return complete(tubes);
  }

  [[nodiscard]] std::vector<SceneTubes> tubes() && { return std::move(all_); }

 private:
  [[nodiscard]] MemoryShare& share() const { return file_->memory->streamlines; }
  [[nodiscard]] std::uint64_t share_of(double part) const {
    return static_cast<std::uint64_t>(part * static_cast<double>(share().capacity()));
  }

  [[nodiscard]] tl::unexpected<Error> fail_without_room() const {
    constexpr double mebibyte = 1 << 20;
    return fail(
        ErrorCode::out_of_budget,
        "{}: the streamlines of {} and their tubes take more than the {:.3g} MiB that memory has for them: take "
        "fewer seeds, shorter lines or thicker tubes, or give more memory",
        file_->volume->name(), all_.back().of.vector, static_cast<double>(left_) / mebibyte);
  }

  // Makes the tubes of lines that are complete.
  Status complete(SceneTubes& tubes) {
    SPLATVOL_TRY_ASSIGN(made, make_tubes(file_->volume->name(), left_, share(), tubes));
    if (!made) return fail_without_room();
    left_ -= tubes.room->bytes();
    return {};
  }

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
    const std::uint64_t of_seeds = streamline_bytes_per_seed * seeds.size();
    auto room = share().reserve(left_);
    if (!room || of_seeds > left_) return fail_without_room();
    limits.rows = (left_ - of_seeds) / streamline_bytes_per_row;
    std::vector<Streamline> lines, without_rows;
    Status made;
    auto next = std::chrono::steady_clock::now();  // the first comes at once
    const std::size_t threads = std::max(1u, std::thread::hardware_concurrency());
    const Status followed = follow_streamlines(*tubes.field, seeds, limits, threads, [&](Streamline line) {
      (line.positions.empty() ? without_rows : lines).push_back(std::move(line));
      const auto now = std::chrono::steady_clock::now();
      if (!take_ || lines.empty() || now < next || !made) return;
      made = show_some(lines, tubes);
      const auto end = std::chrono::steady_clock::now();
      next = end + std::max<std::chrono::steady_clock::duration>(pause, pause_factor * (end - now));
    });
    if (!followed && followed.error().code == ErrorCode::out_of_budget) return fail_without_room();
    SPLATVOL_TRY(followed);
    SPLATVOL_TRY(made);
    if (lines.empty()) return fail_without_lines(volume, without_rows);
    std::ranges::sort(lines, {}, &Streamline::seed);  // so that pictures do not depend on threads
    tubes.lines = std::make_shared<const std::vector<Streamline>>(std::move(lines));
    room.reset();
    return complete(tubes);
  }

  // Shows lines that are there so far, if there is room.
  Status show_some(const std::vector<Streamline>& lines, SceneTubes& tubes) const {
    const std::uint64_t most = share_of(share_of_some);
    if (bytes_of(lines) > most) return {};
    tubes.lines = std::make_shared<const std::vector<Streamline>>(lines);
    SPLATVOL_TRY_ASSIGN(made, make_tubes(file_->volume->name(), most, share(), tubes));
    if (made) take_(all_);
    return {};
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

  std::shared_ptr<const StreamlineFile> file_;
  std::span<const SceneTubes> before_;
  const TakeTubes& take_;
  std::vector<SceneTubes> all_;
  std::uint64_t left_;  // bytes
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
