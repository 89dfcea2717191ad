// Finds the cut whose picture has a wanted error, by looking at pictures.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "base/math.h"
#include "pictures/image.h"
#include "streamer/cut.h"

namespace splatvol {

/// Measures what the error model only expects. If it need not grow, it asks for pictures, one after another: of
/// candidates, of a finer cut as their reference, and perhaps of the whole file one and two resolutions coarser. A
/// candidate's distance to the reference gives its error. docs/accuracy.md says how well this holds.
///
/// Knows nothing of files and devices: the caller draws what `next` asks for, and adds it. The error is the root mean
/// square of linear RGB against the exact picture.
class ErrorControl {
 public:
  /// How it looks for the cut.
  struct Search {
    std::uint64_t most_splats = std::numeric_limits<std::uint64_t>::max();  // that there is room for

    /// Asks for finer and finer pictures, and ends with the first that has the wanted error: soon, but with up to
    /// several times the splats that it needs. Else looks for the cut with the fewest splats.
    bool grows = false;

    /// If above 0: the splats of the first picture, whatever error is expected of it.
    std::uint64_t first_splats = 0;

    /// The most pixels from one sample to the next. If above 1, and it does not grow, few splats get wide samples, and
    /// the last picture has the widest with which its error holds. `pixels`: of a picture.
    int widest_spacing = 1;
    double pixels = 0;
  };

  /// The picture to draw next.
  struct Request {
    ErrorGoal goal = {};
    std::size_t coarser = 0;  // if above 0, instead: everything so many resolutions before the finest
    int sample_spacing = 1;   // pixels
  };

  /// A picture of a request.
  struct Drawn {
    const Image& image;
    std::uint64_t splats;
    double expected_error;  // as ErrorGoal counts it
    bool finest;            // more splats would not change it

    /// The splats that were allowed: fewer than the request's if memory has no room for more.
    std::uint64_t allowed_splats = std::numeric_limits<std::uint64_t>::max();

    double fragments = 0;  // as in FrameTimes
  };

  struct Estimate {
    double error = 0;       // of the last picture
    double file_error = 0;  // of the picture of all points; 0: not looked at, because a cut of fewer splats was finer
    bool reached = false;   // the picture has the wanted error, or lacks it only by the file's own
  };

  /// `max_error`: wanted, above 0.
  explicit ErrorControl(double max_error) : ErrorControl(max_error, Search()) {}
  ErrorControl(double max_error, const Search& search);

  /// Returns what to draw next. Returns nullopt at the end: then the last picture is the one that was looked for.
  [[nodiscard]] const std::optional<Request>& next() const { return next_; }

  /// Adds the picture of `next`. All pictures have the same size.
  void add(const Drawn& drawn);

  /// Returns what is known of the last picture. Requires that `next` is nullopt.
  [[nodiscard]] const Estimate& estimate() const { return estimate_; }

  /// Returns the expected error of the last picture in units of max_error. A nearby view with a goal of this times
  /// max_error has about the same true error. Requires that `next` is nullopt.
  [[nodiscard]] double learned() const { return learned_; }

  /// A cut that was tried, with its estimated error.
  struct Tried {
    std::uint64_t splats;
    double error;
  };
  [[nodiscard]] const std::vector<Tried>& tried() const { return tried_; }

  /// Returns how many pictures were added.
  [[nodiscard]] int pictures() const { return pictures_; }

 private:
  struct Picture {
    std::vector<vec3> samples = {};  // RGB of some of the pixels: evenly spread tiles
    ErrorGoal goal = {};
    std::uint64_t asked = 0;  // the most splats
    std::uint64_t splats = 0;
    double expected = 0;
    bool finest = false;
    int spacing = 1;   // of samples, in pixels
    double ratio = 0;  // of a candidate: its error over the wanted one
    double error = 0;
  };
  enum class Step { candidate, reference, coarser, chosen };

  void grow(Picture picture);
  [[nodiscard]] bool serves(const Picture& candidate) const;
  void judge();
  void add_coarser(Picture picture);
  [[nodiscard]] bool estimate_by_all(double apart);
  [[nodiscard]] bool estimate_by_finer(double apart);
  void ask_candidate(std::uint64_t splats);
  void ask_reference();
  [[nodiscard]] bool is_near_enough() const;
  [[nodiscard]] std::uint64_t next_splats() const;
  void choose(const Picture& chosen);
  [[nodiscard]] int spacing_of(std::uint64_t splats) const;
  [[nodiscard]] bool has_wide_samples(const Picture& candidate) const;
  void widen(const Picture& fine);
  void narrow(const Picture& too_coarse);

  double max_error_;
  Search search_;
  Step step_ = Step::candidate;  // what `next_` is
  std::optional<Request> next_;
  int pictures_ = 0, candidates_ = 0;
  bool shows_candidate_ = false;  // the last picture is that of candidate_
  std::optional<Picture> candidate_, reference_;
  std::optional<Picture> too_coarse_, fine_;  // the best candidates on both sides of the wanted error
  double layers_ = 0;                         // of splats, one behind the other, in a mean pixel; 0: not counted
  bool is_widening_ = false;                  // the cut is found
  bool last_is_fine_ = false;                 // whether the last candidate was fine enough
  int in_a_row_ = 0;                          // candidates that were, or were not, as the last one
  std::optional<double> file_error_;
  double last_apart_ = 0;              // of all points and the resolution before
  std::vector<vec3> coarser_samples_;  // of the resolution before
  std::uint64_t reference_asked_ = 0;
  Estimate estimate_;
  std::vector<Tried> tried_;
  double learned_ = 1;
};

}  // namespace splatvol
