// A case of OpenFOAM: files, each behind a line "==> NAME". Its folders, meshes and fields, and a text as dimensions.
#include <filesystem>
#include <fstream>
#include <set>
#include <string_view>

#include "builder/sources/data_sets_source.h"
#include "builder/sources/openfoam/foam_case.h"
#include "builder/sources/openfoam/foam_dimensions.h"
#include "builder/sources/openfoam/openfoam_reader.h"
#include "builder/sources/reader_error.h"
#include "tests/fuzz/read_source.h"

using namespace splatvol;

namespace {

constexpr std::string_view mark = "==> ";

// Writes the files of an input. Names that lead out of the folder are left out.
void write_files(const std::filesystem::path& folder, std::string_view input) {
  for (std::size_t at = input.find(mark); at != std::string_view::npos;) {
    const std::size_t end = input.find('\n', at);
    if (end == std::string_view::npos) return;
    const std::filesystem::path name(input.substr(at + mark.size(), end - at - mark.size()));
    at = input.find(mark, end);
    const std::string_view text = input.substr(end + 1, std::min(at, input.size()) - end - 1);
    const std::string string = name.string();
    if (name.is_absolute() || string.find("..") != std::string::npos || string.find('\0') != std::string::npos)
      continue;
    std::error_code error;
    std::filesystem::create_directories((folder / name).parent_path(), error);
    std::ofstream(folder / name, std::ios::binary) << text;
  }
}

void read_region(const FoamCase& foam, std::size_t part, const std::string& region, std::optional<double> time) {
  const auto find = [&](const char* name) { return foam.mesh_file(part, region, time, name); };
  const std::vector<FoamPatch> patches = read_foam_patches(find("boundary"));
  const FoamMesh mesh = read_foam_mesh(find);
  check_foam_patches(mesh, patches, "boundary");
  const LabelLists cells = faces_of_cells(mesh);
  fuzz::require(cells.size() == mesh.cell_count, "a cell has faces");
  for (const std::uint32_t point : mesh.faces.values) fuzz::require(point < mesh.points.size(), "a corner is a point");
  const auto all = [](const std::string&) { return true; };
  std::set<std::string> left_out = foam.left_out(part, time, all);
  for (const FoamFieldFile& file : foam.fields(part, region, time, all, &left_out)) {
    const std::uint64_t count = file.kind.of_cells ? mesh.cell_count : mesh.points.size();
    const FoamField field = read_foam_field(file.place, file.kind, count);
    fuzz::require(field.values.size() == count * static_cast<std::size_t>(file.kind.components), "a cell has values");
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view input(reinterpret_cast<const char*>(data), size);
  if (const auto dimensions = read_dimensions(input.substr(0, input.find('\n'))))
    static_cast<void>(unit_of(*dimensions));
  std::string folder = "/dev/shm/splatvol-fuzz-XXXXXX";  // in memory
  fuzz::require(mkdtemp(folder.data()) != nullptr, "there is a temporary folder");
  write_files(folder, input);
  try {
    const FoamCase foam(folder + "/case.foam");
    const std::optional<double> time = foam.times().empty() ? std::nullopt : std::optional(foam.times().back());
    foam.check_parts(time);
    for (std::size_t part = 0; part < std::max<std::size_t>(1, foam.processor_count()); ++part)
      for (const std::string& region : foam.regions()) read_region(foam, part, region, time);
  } catch (const ReaderError&) {
    // The input is refused.
  }
  const InputFile file{.path = folder + "/case.foam", .reader = {open_openfoam}, .patches = true};
  fuzz::read_all(open_files({file}, {}));
  std::error_code ignored;
  std::filesystem::remove_all(folder, ignored);
  return 0;
}
