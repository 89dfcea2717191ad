// The pictures of a view at rest, from coarse to fine.
#pragma once

#include <cstdint>
#include <optional>

#include "player/error_control.h"
#include "player/recipe.h"
#include "splatvol/quality.h"

namespace splatvol {

/// Chooses finer and finer pictures of a view at rest: first of splats, and then of cells, whose samples come closer
/// together. Each picture is a frame's work, so that a user who moves again need not wait for the finest one.
class ProgressiveRefinement final : public Chooser {
 public:
  struct Start {
    /// Of the last picture of splats: it has an error, a tolerance, a number of splats or a resolution. The last two
    /// are one picture. None: there are no pictures of splats.
    std::optional<Quality> splats = {};
    std::uint64_t first_splats = 0;  // of the first picture for an error; 0: what the model expects

    /// The distance of samples in the first picture of cells. 0: there are none.
    int first_spacing = 0;

    /// The picture that is there, if it is of cells: others are finer.
    std::optional<Recipe> shown = {};
  };
  explicit ProgressiveRefinement(const Start& start);

  /// `choices`: for cells. Their samples come no closer together than spacing_of_cells. If nothing comes,
  /// `skip_cells` ends it.
  [[nodiscard]] std::optional<Recipe> next(const Choices& choices) override;

  /// Adds a picture that has settled.
  void add(const Outcome& outcome, const Choices& choices) override;

  /// Needs cells once all pictures of splats are there.
  [[nodiscard]] Needs needs() const override;

  /// Leaves out the rest of the cells: there are none, or they cannot be drawn.
  void skip_cells() { spacing_ = 0; }

  /// Whether the last picture is there.
  [[nodiscard]] bool is_done() const { return !splats_ && spacing_ == 0; }

  /// Returns the distance of samples in the picture after one of cells. 0: there is none.
  [[nodiscard]] static int finer_spacing(int spacing, int finest);

  /// Whether the last picture is one of splats.
  [[nodiscard]] bool shows_splats() const { return has_splats_ && !shown_; }

  /// Whether the last picture is one of cells.
  [[nodiscard]] bool shows_cells() const { return shown_.has_value(); }

  /// Whether the last picture of splats is there, if there are any.
  [[nodiscard]] bool has_all_splats() const { return !splats_; }

  /// Returns the detail of the next picture of splats, or of the last one.
  [[nodiscard]] const Detail& detail() const { return detail_; }

  /// Returns the measured error of the last picture of splats. None before the second, and unless it sharpens to an
  /// error.
  [[nodiscard]] std::optional<double> error() const;

  /// Whether splats sharpen to an error.
  [[nodiscard]] bool seeks_error() const { return control_.has_value(); }

  /// Whether the last picture of splats has the wanted error, or all that the file has.
  [[nodiscard]] bool has_reached() const { return control_ && control_->estimate().reached; }

 private:
  void ask();

  bool splats_ = false;                  // whether there is another picture of splats
  bool has_splats_;                      // or was
  double last_tolerance_ = 0;            // per cent
  std::optional<ErrorControl> control_;  // of an error
  Detail detail_;
  int spacing_;                  // of samples in the next picture of cells; 0: there is none
  std::optional<Recipe> shown_;  // the last picture, if it is of cells
};

}  // namespace splatvol
