// Scattered points from a .csv file: its heading, and all of its lines.
#include "base/file.h"
#include "builder/sources/csv/csv_source.h"
#include "builder/sources/csv/csv_table.h"
#include "tests/fuzz/fuzz.h"
#include "tests/fuzz/read_source.h"
#include "tests/support/memory_source.h"

using namespace splatvol;
using splatvol::fuzz::require;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto bytes = fuzz::bytes_of(data, size);
  const auto file = memory_source(bytes, "fuzz");
  static_cast<void>(read_csv_table(*file, {"x", "y", "z", "_", "p"}));
  const auto table = read_csv_table(*file, {});
  if (!table) return 0;
  require(table->data_offset <= size, "values begin within the file");
  for (const std::size_t column : table->position) require(column < table->columns.size(), "a position is a column");
  for (const std::size_t column : attribute_columns(*table))
    require(column < table->columns.size(), "an attribute is a column");
  const fuzz::NamedBytes named(bytes);
  fuzz::read_all(open_csv_files({named.path()}, {}));
  return 0;
}
