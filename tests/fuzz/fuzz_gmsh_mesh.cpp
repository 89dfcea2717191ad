// A .msh file of Gmsh as a data set.
#include "builder/sources/gmsh/gmsh_reader.h"
#include "tests/fuzz/fuzz.h"

using namespace splatvol;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const fuzz::NamedBytes named(fuzz::bytes_of(data, size));
  const auto sets = open_gmsh({.path = named.path(), .patches = true}, {});
  if (sets) fuzz::require_ok((*sets)->next(), "a mesh that was read is there");
  return 0;
}
