#include "sampler/streamlines.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <condition_variable>
#include <exception>
#include <iterator>
#include <limits>
#include <map>
#include <mutex>
#include <optional>
#include <utility>

#include "base/interruption.h"
#include "base/run_tasks.h"
#include "format/mesh_box.h"
#include "format/splat_reader.h"
#include "sampler/dormand_prince.h"

namespace splatvol {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double tolerance = 1e-5;     // of a step, in weights of corners
constexpr double least_step = 1e-9;    // likewise: a line that can go no further ends
constexpr double no_speed = 1e-12;     // of the largest
constexpr double thinnest = 1e-6;      // height of a tetrahedron, of its extent: flatter ones count as so high
constexpr double usual_diagonals = 5;  // of the mesh's box: a line's length

// By how much each corner's weight changes along each axis.
using Gradients = std::array<dvec3, 4>;

Gradients gradients_in(const TetrahedronCorners& corners) {
  Box box;
  for (const dvec3& corner : corners) box.include(corner);
  const double steepest = 1 / (thinnest * glm::length(box.extent()));
  Gradients gradients{};
  for (std::size_t k = 0; k < 4; ++k) {
    const dvec3 &a = corners[(k + 1) % 4], &b = corners[(k + 2) % 4], &c = corners[(k + 3) % 4];
    const dvec3 normal = glm::cross(b - a, c - a);
    const double area = glm::length(normal), volume = glm::dot(normal, corners[k] - a);
    if (area > 0) gradients[k] = normal / area * std::copysign(std::min(area / std::abs(volume), steepest), volume);
  }
  return gradients;
}

// The changes of weights along a way, and the largest of them.
CornerWeights weights_along(const Gradients& gradients, const dvec3& way) {
  CornerWeights weights{};
  for (std::size_t k = 0; k < 4; ++k) weights[k] = glm::dot(gradients[k], way);
  return weights;
}
double most_along(const Gradients& gradients, const dvec3& way) {
  double most = 0;
  for (const double weight : weights_along(gradients, way)) most = std::max(most, std::abs(weight));
  return most;
}

struct Row {
  dvec3 position{0}, velocity{0};
  double time = 0, length = 0;  // from the seed
  FieldCell cell{};             // that it is in
  Gradients gradients{};        // in it
  double change = 0;            // of the velocity along the line, as a share of it, in a unit of time
  std::vector<double> values = {};
};

// A streamline in one direction.
struct Path {
  std::size_t seed = 0;
  dvec3 start{0};
  double sign = 1;  // of times; velocities have it, too
  std::vector<dvec3> positions = {};
  std::vector<double> times = {};
  std::vector<double> values = {};  // [row][attribute]
  std::optional<StreamlineEnd> end = {};

  Row last = {};
  double step = infinity;   // time of the next one, by the error of the last
  bool has_waited = false;  // in this step

  [[nodiscard]] bool is_begun() const { return !positions.empty(); }

  void add(Row row) {
    positions.push_back(row.position);
    times.push_back(sign * row.time);
    values.insert(values.end(), row.values.begin(), row.values.end());
    last = std::move(row);
    has_waited = false;
  }
};

// Takes steps. For one thread. `rows`: of all paths together.
class Stepper {
 public:
  Stepper(const VectorField& field, const StreamlineLimits& limits, std::size_t threads,
          std::atomic<std::uint64_t>& rows)
      : field_(field), limits_(limits), reader_(field, threads), rows_(rows) {}

  [[nodiscard]] FieldReader& reader() { return reader_; }

  /// Follows a path until it ends, or lacks a chunk (FieldReader::lacking).
  [[nodiscard]] Status follow(Path& path) {
    bool goes_on = true;
    while (goes_on && !path.end) {
      SPLATVOL_TRY(check_interruption());
      const std::size_t before = path.positions.size();
      goes_on = path.is_begun() ? step(path) : begin(path);
      const std::size_t added = path.positions.size() - before;
      if (rows_.fetch_add(added, std::memory_order_relaxed) + added > limits_.rows)
        return fail(ErrorCode::out_of_budget, "streamlines have more than {} rows", limits_.rows);
      if (!goes_on && trouble_ == Trouble::failure) return tl::unexpected(reader_.failure());
    }
    return {};
  }

 private:
  using Found = FieldReader::Found;
  enum class Trouble { none, end, lacking, failure };

  // Sets place_, or trouble_. `near`: where it is likely. `may_wait`: for a chunk that is not held; else it is read.
  bool find(const dvec3& position, const std::optional<FieldCell>& near, bool may_wait) {
    const Found found = reader_.find(position, near, may_wait, place_);
    trouble_ = found == Found::value     ? Trouble::none
               : found == Found::lacking ? Trouble::lacking
               : found == Found::failure ? Trouble::failure
                                         : Trouble::end;
    if (trouble_ == Trouble::end) end_ = found == Found::missing ? StreamlineEnd::missing : StreamlineEnd::mesh;
    return trouble_ == Trouble::none;
  }

  // The row at the place that was found last.
  [[nodiscard]] Row row_at(const dvec3& position, const dvec3& velocity, double time, double length) const {
    Row row{position, velocity, time, length, place_.cell(), gradients_in(place_.corners())};
    row.change = glm::length(place_.vector_of(weights_along(row.gradients, velocity))) / glm::length(velocity);
    for (std::size_t a = 0; a < field_.attribute_count(); ++a) row.values.push_back(place_.value_of(a));
    return row;
  }

  bool begin(Path& path) {
    if (find(path.start, {}, !path.has_waited)) path.add(row_at(path.start, path.sign * place_.vector(), 0, 0));
    return end_if_over(path);
  }

  // Ends a path in trouble, or where it stands still or has all its steps. Returns false if it must wait.
  bool end_if_over(Path& path) {
    if (trouble_ == Trouble::end) path.end = end_;
    if (trouble_ == Trouble::none && !(glm::length(path.last.velocity) > no_speed * field_.largest()))
      path.end = StreamlineEnd::no_speed;
    if (trouble_ == Trouble::none && !path.end && path.positions.size() > limits_.steps)
      path.end = StreamlineEnd::steps;
    return trouble_ == Trouble::none || trouble_ == Trouble::end;
  }

  // Tries a step. Returns its error as a share of what it may be; none in trouble.
  std::optional<double> attempt(const Path& path, double time, Row& row) {
    const Row& from = path.last;
    FieldCell near = from.cell;
    const auto velocity = [&](const dvec3& position) -> std::optional<dvec3> {
      if (!find(position, near, !path.has_waited)) return {};
      near = place_.cell();
      return path.sign * place_.vector();
    };
    const auto step = dormand_prince_step(velocity, from.position, from.velocity, time);
    if (!step) return {};
    if (from.length + step->length > limits_.length) {
      trouble_ = Trouble::end;
      end_ = StreamlineEnd::length;
      return {};
    }
    row = row_at(step->position, step->velocity, from.time + time, from.length + step->length);
    return most_along(from.gradients, step->error) / tolerance;
  }

  // How much longer a step may be, of order 5, than one with this error.
  static double change_of(double error) { return std::clamp(0.9 * std::pow(error, -0.2), 0.2, 5.0); }

  bool step(Path& path) {
    // Nearer and nearer to a place where nothing moves, steps stay as short as the way to it.
    const Row& from = path.last;
    double time = std::min(path.step, 1 / std::max(most_along(from.gradients, from.velocity), from.change));
    for (Row row;;) {
      const std::optional<double> error = attempt(path, time, row);
      if (!error) return trouble_ == Trouble::end && approach_end(path, time);
      if (*error <= 1) {
        path.step = time * change_of(*error);
        path.add(std::move(row));
        return end_if_over(path);
      }
      time *= change_of(*error);
    }
  }

  // Takes the longest step below one that leaves the field. If that is hardly any, the path ends.
  bool approach_end(Path& path, double time) {
    double possible = 0, impossible = time;
    bool is_left = true;  // by the shortest step that is impossible; else that has too large an error
    StreamlineEnd end = end_;
    Row best, row;
    const double in_weights = most_along(path.last.gradients, path.last.velocity);
    while ((impossible - possible) * in_weights > 0.5 * least_step) {
      const double middle = 0.5 * (possible + impossible);
      const std::optional<double> error = attempt(path, middle, row);
      if (!error && trouble_ != Trouble::end) return false;
      if (error && *error <= 1) {
        possible = middle;
        std::swap(best, row);
        continue;
      }
      impossible = middle;
      is_left = !error;
      if (is_left) end = end_;
    }
    trouble_ = Trouble::none;
    const bool is_over = is_left && (possible * in_weights < least_step || end == StreamlineEnd::length);
    path.step = impossible;
    if (possible > 0) path.add(std::move(best));
    if (is_over) path.end = end;
    if (is_left && !is_over && !goes_on(path) && trouble_ != Trouble::end) return false;
    return is_over || end_if_over(path);
  }

  // Whether a least step leads somewhere. Stages of a step may leave the field where the line does not. Waits for no
  // chunk: the row before it was added, and would not be looked at again.
  bool goes_on(const Path& path) {
    const Row& from = path.last;
    return find(from.position + least_step / most_along(from.gradients, from.velocity) * from.velocity, from.cell,
                false);
  }

  const VectorField& field_;
  const StreamlineLimits& limits_;
  FieldReader reader_;
  std::atomic<std::uint64_t>& rows_;
  FieldPlace place_;
  Trouble trouble_ = Trouble::none;
  StreamlineEnd end_ = StreamlineEnd::mesh;
};

// Appends a path to a line: against the vectors the last row first, and otherwise without the seed if it is there.
void append(Path& path, bool is_backward, Streamline& line) {
  const std::size_t rows = path.positions.size(), all = line.positions.size() + rows;
  line.positions.reserve(all);
  line.times.reserve(all);
  for (std::vector<double>& values : line.values) values.reserve(all);
  for (std::size_t i = !is_backward && !line.positions.empty() ? 1 : 0; i < rows; ++i) {
    const std::size_t row = is_backward ? rows - 1 - i : i;
    line.positions.push_back(path.positions[row]);
    line.times.push_back(path.times[row]);
    for (std::size_t a = 0; a < line.values.size(); ++a)
      line.values[a].push_back(path.values[row * line.values.size() + a]);
  }
  (is_backward ? line.begin : line.end) = *path.end;
  path = {};
}

// All paths of some seeds. Several threads follow them.
class Paths {
 public:
  Paths(const VectorField& field, std::span<const dvec3> seeds, const StreamlineLimits& limits,
        const std::function<void(Streamline)>& take)
      : field_(field), limits_(limits), take_(take) {
    for (std::size_t seed = 0; seed < seeds.size(); ++seed)
      for (const double sign : {-1., 1.})
        if (limits.direction != (sign > 0 ? StreamlineDirection::backward : StreamlineDirection::forward))
          paths_.push_back({.seed = seed, .start = seeds[seed], .sign = sign});
    for (std::size_t path = 0; path < paths_.size(); ++path) waiting_[no_chunk].push_back(path);
  }

  // Follows paths until all have ended. For each of `threads`.
  [[nodiscard]] Status follow(std::size_t threads) {
    Stepper stepper(field_, limits_, threads, rows_);
    std::unique_lock lock(mutex_);
    for (;;) {
      changed_.wait(lock, [&] { return has_failed_ || !waiting_.empty() || working_ == 0; });
      if (has_failed_ || waiting_.empty()) return {};
      const auto [chunk, paths] = take_some(threads);
      ++working_;
      lock.unlock();
      // Without memory, the others must not wait for this thread.
      Status status;
      std::exception_ptr exception;
      try {
        status = follow_some(stepper, chunk, paths);
      } catch (...) {
        exception = std::current_exception();
      }
      lock.lock();
      --working_;
      has_failed_ = has_failed_ || !status || exception;
      changed_.notify_all();
      if (exception) std::rethrow_exception(exception);
      if (!status) return status;
    }
  }

 private:
  static constexpr std::uint32_t no_chunk = std::numeric_limits<std::uint32_t>::max();

  // Takes a thread's part of those that wait for the same chunk, for which most of all wait.
  std::pair<std::uint32_t, std::vector<std::size_t>> take_some(std::size_t threads) {
    const auto most = std::ranges::max_element(waiting_, {}, [](const auto& waiting) { return waiting.second.size(); });
    auto& [chunk, paths] = *most;
    const auto count = static_cast<std::ptrdiff_t>((paths.size() + threads - 1) / threads);
    std::pair<std::uint32_t, std::vector<std::size_t>> some{chunk, {paths.end() - count, paths.end()}};
    paths.erase(paths.end() - count, paths.end());
    if (paths.empty()) waiting_.erase(most);
    return some;
  }

  Status follow_some(Stepper& stepper, std::uint32_t chunk, const std::vector<std::size_t>& paths) {
    if (chunk != no_chunk) SPLATVOL_TRY(stepper.reader().read(chunk));
    for (const std::size_t path : paths) {
      paths_[path].has_waited = chunk != no_chunk;
      SPLATVOL_TRY(stepper.follow(paths_[path]));
      const std::scoped_lock lock(mutex_);
      if (paths_[path].end)
        finish(path);
      else
        waiting_[stepper.reader().lacking()].push_back(path);
      changed_.notify_all();
    }
    return {};
  }

  // Gives a line away once both of its paths have ended. Requires the lock.
  void finish(std::size_t number) {
    const bool has_two = limits_.direction == StreamlineDirection::both;
    const std::size_t first = has_two ? number / 2 * 2 : number, last = has_two ? first + 1 : first;
    if (!paths_[first].end || !paths_[last].end) return;
    Streamline line;
    line.seed = paths_[first].seed;
    line.values.resize(field_.attribute_count());
    for (std::size_t path = first; path <= last; ++path) append(paths_[path], paths_[path].sign < 0, line);
    if (line.positions.size() < 2) {
      line.positions.clear(), line.times.clear();
      for (std::vector<double>& values : line.values) values.clear();
    }
    take_(std::move(line));
  }

  const VectorField& field_;
  const StreamlineLimits& limits_;
  const std::function<void(Streamline)>& take_;
  std::vector<Path> paths_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::map<std::uint32_t, std::vector<std::size_t>> waiting_;  // [chunk]: paths
  std::size_t working_ = 0;                                    // threads
  std::atomic<std::uint64_t> rows_ = 0;
  bool has_failed_ = false;
};

}  // namespace

std::string name_of(StreamlineEnd end) {
  constexpr std::array<const char*, 6> names = {"seed", "mesh", "missing", "no_speed", "length", "steps"};
  return names[static_cast<std::size_t>(end)];
}

Status follow_streamlines(const VectorField& field, std::span<const dvec3> seeds, const StreamlineLimits& limits,
                          std::size_t threads, const std::function<void(Streamline)>& take) {
  Paths paths(field, seeds, limits, take);
  return run_tasks(threads, threads, [&](std::size_t, std::size_t) { return paths.follow(threads); });
}

Result<StreamlineLimits> limits_of(const StreamlineRequest& request, const format::Volume& volume) {
  StreamlineLimits limits{request.direction, request.max_length.value_or(0), request.max_steps};
  if (request.max_length && !(limits.length > 0))
    return fail(ErrorCode::invalid_argument, "{}: {} is no length of streamlines", volume.name(), limits.length);
  if (limits.steps == 0) return fail(ErrorCode::invalid_argument, "{}: streamlines need steps", volume.name());
  if (!request.max_length) {
    SPLATVOL_TRY_ASSIGN(box, format::mesh_box(volume));
    limits.length = usual_diagonals * glm::length(box.extent());
  }
  return limits;
}

tl::unexpected<Error> fail_without_lines(const format::Volume& volume, std::span<const Streamline> lines) {
  const auto count = [&](StreamlineEnd end) { return std::ranges::count(lines, end, &Streamline::end); };
  SPLATVOL_TRY_ASSIGN(box, format::mesh_box(volume));
  return fail(
      ErrorCode::invalid_argument,
      "{}: no seed has a streamline: {} are in no cell, {} where the vector has no value, {} where it is 0; the "
      "mesh reaches from ({:.6g}, {:.6g}, {:.6g}) to ({:.6g}, {:.6g}, {:.6g})",
      volume.name(), count(StreamlineEnd::mesh), count(StreamlineEnd::missing), count(StreamlineEnd::no_speed),
      box.low.x, box.low.y, box.low.z, box.high.x, box.high.y, box.high.z);
}

Result<Streamlines> find_streamlines(const format::Volume& volume, const StreamlineRequest& request,
                                     std::uint64_t memory, std::size_t threads) {
  SPLATVOL_TRY_ASSIGN(selection, format::select_splats(volume, {}, request.attributes, format::SplatSelection().box));
  SPLATVOL_TRY_ASSIGN(limits, limits_of(request, volume));
  SPLATVOL_TRY_ASSIGN(field, VectorField::open(volume, request.vector, selection.names,
                                               own_room(std::min(memory, usual_streamline_bytes))));
  SPLATVOL_TRY_ASSIGN(seeds, positions_of(request.seeds, volume, memory));
  Streamlines streamlines{std::move(selection.names), std::vector<Streamline>(seeds.size())};
  bool has_line = false;
  SPLATVOL_TRY(follow_streamlines(*field, seeds, limits, threads, [&](Streamline line) {
    has_line = has_line || !line.positions.empty();
    const std::size_t seed = line.seed;
    streamlines.lines[seed] = std::move(line);
  }));
  if (!has_line) return fail_without_lines(volume, streamlines.lines);
  return streamlines;
}

}  // namespace splatvol
