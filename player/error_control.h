// Finds the picture of a wanted error with the least work, by looking at pictures.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "base/math.h"
#include "pictures/image.h"
#include "player/rays.h"
#include "player/recipe.h"
#include "renderer/work.h"

namespace splatvol {

/// Measures what the error model only expects. If it need not grow, it tries *candidates*: cuts of some number of
/// splats, or cells, with some distance of samples. It ends when one has the wanted error, and no other that has it is
/// less work. Work is counted (renderer/work.h), and no clock decides.
///
/// Exact rays tell a candidate's error. Without them, its distance to a *reference* does: a finer cut, or the whole
/// file, and then the file's pictures one and two resolutions coarser. docs/accuracy.md says how well this holds.
///
/// The error is the root mean square of linear RGB against the exact picture.
class ErrorControl final : public Chooser {
 public:
  /// How it looks for the picture.
  struct Search {
    std::uint64_t most_splats = std::numeric_limits<std::uint64_t>::max();  // that there is room for

    /// Asks for finer and finer pictures, and ends with the first that has the wanted error: soon, but with up to
    /// several times the work that it needs.
    bool grows = false;

    /// If above 0: the splats of the first picture, whatever error is expected of it.
    std::uint64_t first_splats = 0;

    /// The pixels from one sample to the next; `finest_spacing` if it grows. `pixels`: of a picture.
    int finest_spacing = 1, widest_spacing = 1;
    double pixels = 0;
    std::size_t resolutions = 1;  // of the file

    std::optional<Rays> rays = {};         // if any, errors are against these
    std::optional<CellCounts> cells = {};  // if any, an exact picture may be asked for; not if it grows
  };

  struct Estimate {
    double error = 0;       // of the last picture
    double file_error = 0;  // of the picture of all points; 0: not looked at
    bool reached = false;   // the picture has the wanted error, or lacks it only by the file's own
    bool measured = false;  // against exact rays
  };

  /// `max_error`: wanted, above 0.
  explicit ErrorControl(double max_error) : ErrorControl(max_error, Search()) {}
  ErrorControl(double max_error, Search search);

  /// All pictures have the same size. Heeds no choices but those of its search.
  [[nodiscard]] std::optional<Recipe> next(const Choices& choices) override;
  void add(const Outcome& outcome, const Choices& choices) override;
  [[nodiscard]] Needs needs() const override { return {.picture = true}; }

  /// Returns what is known of the last picture. Requires that `next` returns nothing.
  [[nodiscard]] const Estimate& estimate() const { return estimate_; }

  /// Returns the expected error of the last picture in units of max_error. A nearby view with a goal of this times
  /// max_error has about the same true error. Requires that `next` returns nothing.
  [[nodiscard]] double learned() const { return learned_; }

  /// A picture that was tried, with its estimated error.
  struct Tried {
    std::uint64_t splats;  // 0: cells
    int sample_spacing;
    double error;
    double work;  // nanoseconds (renderer/work.h)
  };
  [[nodiscard]] const std::vector<Tried>& tried() const { return tried_; }

  /// Returns how many pictures were added.
  [[nodiscard]] int pictures() const { return pictures_; }

 private:
  struct Picture {
    std::vector<vec3> samples = {};  // RGB of some of the pixels
    ErrorGoal goal = {};
    std::uint64_t asked = 0;  // the most splats
    std::uint64_t splats = 0;
    double expected = 0;
    bool finest = false;
    bool exact = false;
    int spacing = 1;   // of samples, in pixels
    double work = 0;   // nanoseconds
    double error = 0;  // estimated
    double ratio = 0;  // of a candidate: its error over the wanted one
  };
  enum class Step { candidate, reference, coarser, chosen };

  // The picture to draw next.
  struct Request {
    ErrorGoal goal = {};
    std::size_t coarser = 0;  // if above 0, instead: everything so many resolutions before the finest
    bool exact = false;       // if true, instead: the cells
    int sample_spacing = 1;   // pixels
  };

  // Candidates of one sample spacing.
  struct Bracket {
    int spacing = 1;
    std::uint64_t first_splats = 1;
    std::optional<Picture> too_coarse = {}, fine = {};  // the best on both sides of the wanted error
    std::optional<Picture> coarser = {};                // the last one that was too coarse before `too_coarse`
    bool last_is_fine = false;                          // whether the last candidate was fine enough
    int in_a_row = 0;                                   // candidates that were, or were not, as the last one
    int candidates = 0;
  };

  // Estimates.
  [[nodiscard]] bool estimate(Picture& candidate);
  [[nodiscard]] bool serves(const Picture& candidate) const;
  void add_coarser(Picture picture);
  [[nodiscard]] bool estimate_by_all(double apart);
  [[nodiscard]] bool estimate_by_finer(double apart);
  void ask_reference();
  [[nodiscard]] bool has_wide_samples(const Picture& candidate) const;
  [[nodiscard]] int finer_spacing(const Picture& candidate) const {
    return std::max(candidate.spacing / 2, search_.finest_spacing);
  }

  // The search.
  void grow(Picture picture);
  void judge();
  void add_to_bracket(const Picture& candidate);
  void go_on();
  [[nodiscard]] bool is_near_enough() const;
  [[nodiscard]] bool has_stalled() const;
  [[nodiscard]] std::uint64_t next_splats() const;
  void ask_candidate(std::uint64_t splats, int spacing);
  [[nodiscard]] bool ask_cells(double less_work_than);
  void narrow();
  [[nodiscard]] bool rules_out_narrower(const Picture& cells) const;
  [[nodiscard]] bool is_no_better(const Picture& narrow) const;
  void widen_again();
  [[nodiscard]] bool probe();
  void end();
  void choose(const Picture& chosen);
  [[nodiscard]] double samples_of(int spacing) const { return search_.pixels / (spacing * spacing); }
  [[nodiscard]] double work_of(double splats, int spacing) const;
  [[nodiscard]] double work_of_exact(int spacing) const;

  double max_error_;
  Search search_;
  Step step_ = Step::candidate;  // what `next_` is
  std::optional<Request> next_;
  int pictures_ = 0;
  bool shows_candidate_ = false;  // the last picture is that of candidate_
  std::optional<Picture> candidate_, reference_;
  std::vector<vec3> rays_;
  Bracket bracket_;
  bool may_narrow_;              // whether narrower samples may help
  std::optional<Bracket> wide_;  // of samples that were wider, until the first candidate of narrower ones is there
  std::optional<Picture> best_;  // the candidate of the wanted error with the least work
  bool is_probing_ = false;      // whether another spacing is less work
  int exact_spacing_ = 0;        // the widest of cells that was not tried; 0: none is left
  double layers_ = 0;            // layers_of_one_splat, by the last picture of splats; 0: not counted
  std::optional<double> file_error_;
  double last_apart_ = 0;              // of all points and the resolution before
  std::vector<vec3> coarser_samples_;  // of the resolution before
  std::uint64_t reference_asked_ = 0;
  Estimate estimate_;
  std::vector<Tried> tried_;
  double learned_ = 1;
};

/// Asks for all points, and finds out their error. Without rays, it asks for the two resolutions before, first.
class AllPoints final : public Chooser {
 public:
  AllPoints(std::size_t resolutions, std::optional<Rays> rays);

  [[nodiscard]] std::optional<Recipe> next(const Choices& choices) override;
  void add(const Outcome& outcome, const Choices& choices) override;
  [[nodiscard]] Needs needs() const override { return {.picture = true}; }

  /// Returns their error, once `next` returns nothing. None if a file has too few resolutions to tell.
  [[nodiscard]] const std::optional<ErrorControl::Estimate>& estimate() const { return estimate_; }

  /// Returns how many pictures were added.
  [[nodiscard]] int pictures() const { return pictures_; }

 private:
  std::size_t resolutions_;
  std::optional<Rays> rays_;
  int coarser_;  // how many coarser pictures come yet; -1: all is there
  std::vector<std::vector<vec3>> samples_ = {};
  std::optional<ErrorControl::Estimate> estimate_ = {};
  int pictures_ = 0;
};

}  // namespace splatvol
