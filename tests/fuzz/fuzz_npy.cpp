// Scattered points from a .npy file: its header, and all of its rows.
#include "base/file.h"
#include "builder/sources/numpy/npy_header.h"
#include "builder/sources/numpy/npy_source.h"
#include "tests/fuzz/fuzz.h"
#include "tests/fuzz/read_source.h"
#include "tests/support/memory_source.h"

using namespace splatvol;
using splatvol::fuzz::require;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto bytes = fuzz::bytes_of(data, size);
  const auto file = memory_source(bytes, "fuzz");
  const auto table = read_npy_header(*file);
  if (!table) return 0;
  require(table->columns.size() <= 4096, "a table has few columns");
  for (const NpyColumn& column : table->columns)
    if (column.kind != NpyColumn::Kind::other && table->rows > 0)
      require(check_range(*file, column.offset + (table->rows - 1) * table->stride, column.bytes).has_value(),
              "the last number of a column is in the file");
  const fuzz::NamedBytes named(bytes);
  fuzz::read_all(open_npy_files({named.path()}, {}));
  return 0;
}
