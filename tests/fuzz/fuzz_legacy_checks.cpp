// The check of a legacy .vtk file that comes before VTK's reader.
#include "builder/sources/vtk/legacy_checks.h"
#include "tests/fuzz/fuzz.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const splatvol::fuzz::NamedBytes file(splatvol::fuzz::bytes_of(data, size));
  static_cast<void>(splatvol::legacy_arrays(file.path()));
  return 0;
}
