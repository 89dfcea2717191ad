// Several time steps of one mesh as one source.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "builder/sources/source.h"

namespace splatvol {

/// A time step that can be opened.
struct SeriesStep {
  std::string name;            // for messages and provenance
  std::optional<double> time;  // none: the time that its source states, if any
  std::function<Result<std::unique_ptr<Source>>()> open;
};

/// The attributes of several steps, one step after another, as attributes of one source. The mesh is that of the first
/// step; next() fails if another step has other points, cells or attributes. Steps may have their attributes in any
/// order. Holds a piece of each step, and its source if it has several pieces.
///
/// The copies of a vertex are the same at all steps, whatever the values. Points of one position are copies if the
/// input has several pieces. They are none if values of cells are averaged in each piece by itself. If blocks are to
/// stay apart, points of different blocks are none.
class StepGroup final : public Source {
 public:
  /// Opens the first step. Requires a step. `blocks_apart`: whether vertices of different blocks are no copies.
  /// `attributes`: of each step, in the order of step_attributes(); empty: those of the first step.
  [[nodiscard]] static Result<std::unique_ptr<StepGroup>> open(std::vector<SeriesStep> steps, bool blocks_apart,
                                                               std::vector<std::string> attributes = {});

  [[nodiscard]] const std::vector<std::string>& step_attributes() const { return step_attributes_; }

  /// [step]: as Source::stated_time(). Known after the first piece.
  [[nodiscard]] const std::vector<std::optional<double>>& stated_times() const { return stated_times_; }

  [[nodiscard]] const std::vector<std::string>& attributes() const override { return attributes_; }
  [[nodiscard]] std::vector<std::string> units() const override;
  [[nodiscard]] std::vector<int> components() const override;
  [[nodiscard]] std::size_t piece_count() const override { return first_->piece_count(); }
  [[nodiscard]] Result<std::unique_ptr<Piece>> next() override;
  [[nodiscard]] Result<std::optional<Box>> bounds() override { return first_->bounds(); }
  [[nodiscard]] std::optional<std::uint64_t> point_count() const override { return first_->point_count(); }
  [[nodiscard]] std::vector<std::string> conversions() const override;
  [[nodiscard]] std::uint64_t left_out_cells() const override { return first_->left_out_cells(); }
  [[nodiscard]] VertexCopies copies() const override { return copies_; }
  void tell_whole_cells() override { first_->tell_whole_cells(); }
  [[nodiscard]] bool may_have_cells() const override { return first_->may_have_cells(); }
  [[nodiscard]] bool brings_material() const override { return first_->brings_material(); }
  [[nodiscard]] bool single_precision() const override { return first_->single_precision(); }

 private:
  StepGroup(std::vector<SeriesStep> steps, std::unique_ptr<Source> first, bool blocks_apart,
            std::vector<std::string> attributes, const std::vector<std::size_t>& order);
  void note_conversions(std::size_t step);
  [[nodiscard]] Status open_other(std::size_t step);
  [[nodiscard]] Status add(std::size_t step, std::unique_ptr<Piece> other, Piece& piece);
  [[nodiscard]] bool has_same_block(std::size_t step, std::uint64_t first, std::uint64_t other);
  [[nodiscard]] Status close_finished(std::size_t step);

  std::vector<SeriesStep> steps_;
  std::unique_ptr<Source> first_;
  std::vector<std::unique_ptr<Source>> others_;  // [step]; null: not open yet, or finished
  std::vector<bool> finished_;                   // [step]
  std::vector<std::string> step_attributes_, attributes_;
  std::vector<std::vector<std::size_t>> orders_;  // [step][attribute]: its number in the source of the step
  std::vector<std::string> units_;                // of the attributes of a step; of the first one that tells
  std::vector<int> components_;                   // of the attributes of a step
  std::vector<std::string> conversions_;          // of other steps, without those that a step before has
  VertexCopies copies_;
  std::vector<std::map<std::uint64_t, std::uint64_t>> blocks_, first_blocks_;  // [step]: by the first step's, and back
  std::vector<std::optional<double>> stated_times_;
};

/// The hint of messages that refuse a mesh that changes.
inline constexpr const char* series_of_files_hint =
    "the steps of one file need one mesh; svbuild --times all --series-of-files writes a file for each step";

}  // namespace splatvol
