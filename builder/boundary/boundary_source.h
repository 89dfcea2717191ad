// A source whose pieces add to the boundary on their way.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "builder/boundary/boundary_faces.h"
#include "builder/sources/source.h"

namespace splatvol {

/// Adds the faces of each piece to `faces`, and returns it without its patches. Both must outlive this.
class BoundarySource final : public Source {
 public:
  BoundarySource(Source& source, BoundaryFaces& faces) : source_(source), faces_(faces) {}

  [[nodiscard]] Result<std::unique_ptr<Piece>> next() override;

  const std::vector<std::string>& attributes() const override { return source_.attributes(); }
  std::vector<std::string> units() const override { return source_.units(); }
  std::vector<int> components() const override { return source_.components(); }
  void lend_values() override { source_.lend_values(); }
  std::size_t piece_count() const override { return source_.piece_count(); }
  PieceNumber piece_number() const override { return source_.piece_number(); }
  Result<std::optional<Box>> bounds() override { return source_.bounds(); }
  std::optional<std::uint64_t> point_count() const override { return source_.point_count(); }
  std::optional<TimeStep> time_step() const override { return source_.time_step(); }
  std::optional<double> stated_time() const override { return source_.stated_time(); }
  std::vector<std::string> conversions() const override { return source_.conversions(); }
  std::uint64_t left_out_cells() const override { return source_.left_out_cells(); }
  bool averages_by_piece() const override { return source_.averages_by_piece(); }
  VertexCopies copies() const override { return source_.copies(); }
  bool may_have_cells() const override { return source_.may_have_cells(); }
  bool brings_material() const override { return source_.brings_material(); }
  bool single_precision() const override { return source_.single_precision(); }

 private:
  Source& source_;
  BoundaryFaces& faces_;
};

}  // namespace splatvol
