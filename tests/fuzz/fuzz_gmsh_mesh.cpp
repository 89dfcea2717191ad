// A .msh file of Gmsh to its pieces.
#include "builder/sources/data_sets_source.h"
#include "builder/sources/gmsh/gmsh_reader.h"
#include "tests/fuzz/read_source.h"

using namespace splatvol;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const fuzz::NamedBytes named(fuzz::bytes_of(data, size));
  const InputFile file{.path = named.path(), .reader = {open_gmsh, list_gmsh_arrays}, .patches = true};
  fuzz::read_all(open_files({file}, {}));
  return 0;
}
