// A mesh of SU2, and behind a byte 0 the .csv file with its values.
#include "builder/sources/data_sets_source.h"
#include "builder/sources/su2/su2_reader.h"
#include "tests/fuzz/read_source.h"

using namespace splatvol;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto bytes = fuzz::bytes_of(data, size);
  const auto cut = static_cast<std::size_t>(std::ranges::find(bytes, std::byte{0}) - bytes.begin());
  const fuzz::NamedBytes mesh(bytes.first(cut)), values(bytes.subspan(std::min(bytes.size(), cut + 1)));
  const InputFile file{
      .path = mesh.path(), .reader = {open_su2, list_su2_arrays}, .values = values.path(), .patches = true};
  fuzz::read_all(open_files({file}, {}));
  return 0;
}
