// The check of an XML file of VTK that comes before VTK's reader, and the list of its arrays. VTK's parser, which it
// uses, is not instrumented.
#include "builder/sources/vtk/xml_arrays.h"
#include "builder/sources/vtk/xml_checks.h"
#include "tests/fuzz/fuzz.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const splatvol::fuzz::NamedBytes file(splatvol::fuzz::bytes_of(data, size));
  static_cast<void>(splatvol::check_xml(file.path()));
  static_cast<void>(splatvol::xml_arrays(file.path()));
  return 0;
}
