// What a picture is made of, what came of it, and who chooses it.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "base/math.h"
#include "pictures/image.h"
#include "renderer/work.h"
#include "streamer/splats/cut.h"

namespace splatvol {

/// The most pixels from one sample to the next in a picture of a wanted time.
inline constexpr int widest_samples_in_a_time = 4;

/// The same while something moves, and its error is measured.
inline constexpr int widest_moving_samples = 16;

/// What a picture is made of: splats of a detail, or the cells that a file keeps, and the distance of samples. The
/// picture does not depend on how its recipe was found.
struct Recipe {
  std::optional<Detail> splats = {};  // none: cells
  int sample_spacing = 0;             // pixels; 0: as Drawing tells, or else the detail

  [[nodiscard]] static Recipe of_cells(int sample_spacing = 0) { return {{}, sample_spacing}; }
  [[nodiscard]] static Recipe of_splats(std::uint64_t most_splats, int sample_spacing = 0) {
    return {Detail{.goal = ErrorGoal{0, most_splats}}, sample_spacing};
  }

  [[nodiscard]] bool is_exact() const { return !splats; }

  /// Returns the most splats that it may have. 0: cells.
  [[nodiscard]] std::uint64_t most_splats() const { return splats ? splats->goal.value_or(ErrorGoal{}).max_splats : 0; }

  [[nodiscard]] bool operator==(const Recipe&) const = default;
};

/// What came of a recipe.
struct Outcome {
  Recipe recipe = {};                         // as it was drawn: budgets may have made it coarser
  std::uint64_t splats = 0;                   // of the picture
  std::optional<double> expected_error = {};  // of splats without missing parts: by the file's index, as ErrorGoal
  bool finest = false;                        // more splats would not change it
  double fragments = 0;                       // of splats, as in FrameTimes
  double segments = 0;                        // of cells, in all samples
  double seconds = 0;                         // 0: not known, as some parts were read or are missing
  std::optional<double> error = {};           // measured: root mean square of linear RGB
  const Image* picture = nullptr;             // if the chooser needs it: while it is told
};

/// What can be drawn of a view.
struct Choices {
  std::uint64_t points = std::numeric_limits<std::uint32_t>::max();  // that can be drawn
  std::uint64_t least_splats = 1;
  int finest_spacing = 1, widest_spacing = widest_samples_in_a_time;
  double pixels = 512 * 512;
  std::optional<CellCounts> cells = {};  // none: they cannot be drawn
  bool has_splats = true;                // false: cells alone show what there is to see; there must be some

  double most_segments = std::numeric_limits<double>::infinity();  // of cells, in all samples
  double first_cells_seconds = 1.0 / 12;  // cells that have the wanted error in this time come before splats
  double surfaces_seconds = 0;            // that surfaces and slices take beside any recipe
  double added_error = 0;                 // expected of splats, as they lack something
  dvec3 direction = {0, 0, 1};            // of the view
};

/// Chooses recipes, one after the other, and learns from what came of them. Knows nothing of files and devices.
class Chooser {
 public:
  Chooser() = default;
  Chooser(const Chooser&) = default;
  Chooser& operator=(const Chooser&) = default;
  virtual ~Chooser() = default;

  /// Returns what to draw next. Nothing: the last picture is the one that was looked for.
  [[nodiscard]] virtual std::optional<Recipe> next(const Choices& choices) = 0;

  /// Adds what came of it.
  virtual void add(const Outcome& outcome, const Choices& choices) = 0;

  /// Which cells it may draw: those that are there or in a near file, or all.
  enum class Cells { none, near, all };

  /// What it must be told.
  struct Needs {
    Cells cells = Cells::none;           // Choices::cells
    int widest_spacing = 1;              // as Choices has it
    bool picture = false;                // Outcome::picture
    std::optional<double> seconds = {};  // parts of the file that come later are not waited for; none: all are
    bool steady_time = false;            // Outcome::seconds of a picture for which nothing is read
  };
  [[nodiscard]] virtual Needs needs() const = 0;
};

/// Returns recipes of splats, from few to all points: the rungs of a ladder that is the same on all machines. Each has
/// sqrt(2) times the splats of the one below it. None if splats cannot be drawn.
[[nodiscard]] std::vector<Recipe> ladder_of_splats(const Choices& choices);

}  // namespace splatvol
