#include "tests/support/whole_points.h"

#include <filesystem>
#include <utility>

#include "builder/points/held_points.h"
#include "builder/points/point_stream.h"

namespace splatvol::test {

Result<WholePoints> read_points(Source& source, bool use_cells, std::size_t memory) {
  SPLATVOL_TRY_ASSIGN(
      stream, PointStream::create(source, use_cells, memory, std::filesystem::temp_directory_path(), [](double) {}));
  SPLATVOL_TRY_ASSIGN(
      points, hold_all([&](PointBatch& batch) { return stream.next(batch); }, stream.summary().attributes.size()));
  return WholePoints{stream.summary(), std::move(points)};
}

}  // namespace splatvol::test
