// Our own checks and parsers of formats that others read: EnSight, NetCDF and HDF5, PLOT3D, surfaces. The first
// character tells which.
#include <span>
#include <string_view>

#include "base/file.h"
#include "builder/sources/ensight/ensight_case.h"
#include "builder/sources/ensight/ensight_checks.h"
#include "builder/sources/ensight/finer_numbers.h"
#include "builder/sources/hdf5/netcdf_checks.h"
#include "builder/sources/plot3d/plot3d_format.h"
#include "builder/sources/surfaces/gltf_checks.h"
#include "builder/sources/surfaces/surface_checks.h"
#include "tests/fuzz/fuzz.h"
#include "tests/support/memory_source.h"

using namespace splatvol;

namespace {

constexpr std::string_view ghost_geometry =
    "d\nd\nnode id assign\nelement id assign\npart\n1\np\ncoordinates\n4\n"
    "0\n1\n0\n0\n0\n0\n1\n0\n0\n0\n0\n1\n"
    "g_tetra4\n1\n1 2 3 4\ntetra4\n2\n1 2 3 4\n1 2 3 4\n";

// The text of a case; behind a byte 0, the geometry that it names as "g".
void check_ensight(std::span<const std::byte> bytes) {
  const auto cut = std::ranges::find(bytes, std::byte{0}) - bytes.begin();
  const auto text = bytes.first(static_cast<std::size_t>(cut));
  const EnsightCase files({reinterpret_cast<const char*>(text.data()), text.size()});
  static_cast<void>(files.times());
  static_cast<void>(has_finer_number({reinterpret_cast<const char*>(text.data()), text.size()}));
  for (const EnsightFiles& variable : files.variables()) static_cast<void>(files.file_at(variable, 0.5));
  const fuzz::NamedBytes named(text);
  static_cast<void>(read_ensight_case(named.path()));

  const fuzz::NamedBytes geometry(bytes.subspan(std::min(bytes.size(), text.size() + 1)));
  const EnsightCase fixed(
      "FORMAT\ntype: ensight gold\nGEOMETRY\nmodel: " + geometry.path().substr(geometry.path().find_last_of('/') + 1) +
      "\nVARIABLE\nscalar per node: p " + geometry.path().substr(geometry.path().find_last_of('/') + 1) + "\n");
  static_cast<void>(check_ensight_files(geometry.path(), fixed, {}));

  // The bytes as values of elements, of which one is a ghost.
  static const fuzz::NamedBytes ghosts(std::as_bytes(std::span(ghost_geometry)));
  const auto name_of = [](const fuzz::NamedBytes& file) {
    return file.path().substr(file.path().find_last_of('/') + 1);
  };
  for (const char* kind : {"scalar", "tensor symm"})
    static_cast<void>(
        check_ensight_files(geometry.path(),
                            EnsightCase("FORMAT\ntype: ensight gold\nGEOMETRY\nmodel: " + name_of(ghosts) +
                                        "\nVARIABLE\n" + kind + " per element: q " + name_of(geometry) + "\n"),
                            {}));
}

// A grid of PLOT3D and its solution, halves of the input.
void check_plot3d(std::span<const std::byte> bytes) {
  fuzz::Input input(bytes);
  const std::size_t middle = std::min<std::size_t>(input.take<std::uint16_t>(), input.rest().size());
  const auto grid = memory_source(input.rest().first(middle), "fuzz");
  const auto solution = memory_source(input.rest().subspan(middle), "fuzz");
  static_cast<void>(detect_plot3d(*grid, *solution));
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const auto rest = fuzz::bytes_of(data + 1, size - 1);
  if (data[0] == 'e') check_ensight(rest);
  if (data[0] == 'p') check_plot3d(rest);
  if (data[0] == 'e' || data[0] == 'p') return 0;
  const fuzz::NamedBytes file(rest);
  if (data[0] == 'n') {
    static_cast<void>(check_file_end(file.path()));
    static_cast<void>(count_open_records(file.path()));
  }
  if (data[0] == 'g') static_cast<void>(check_gltf(file.path()));
  if (data[0] == 's') static_cast<void>(check_stl(file.path()));
  if (data[0] == 'y') static_cast<void>(check_ply(file.path()));
  if (data[0] == 'o') static_cast<void>(check_obj(file.path()));
  return 0;
}
