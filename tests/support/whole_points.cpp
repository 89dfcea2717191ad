#include "tests/support/whole_points.h"

#include <filesystem>

namespace splatvol::test {

Result<WholePoints> read_points(Source& source, bool use_cells, std::size_t memory) {
  SPLATVOL_TRY_ASSIGN(
      stream, PointStream::create(source, use_cells, memory, std::filesystem::temp_directory_path(), [](double) {}));
  WholePoints whole;
  const std::size_t attributes = stream.summary().attributes.size();
  whole.points.values.resize(attributes);
  whole.points.value_moments.resize(attributes);
  whole.points.gradients.resize(attributes);
  for (bool more = true; more;) {
    SPLATVOL_TRY_ASSIGN(any, stream.next(whole.points));
    more = any;
  }
  whole.summary = stream.summary();
  return whole;
}

}  // namespace splatvol::test
