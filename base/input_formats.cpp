#include "base/input_formats.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <string>
#include <system_error>

#include "base/names.h"
#include "base/replaceable.h"

namespace splatvol {
namespace {

constexpr std::array<FormatRow, input_format_count> rows = {{
    {InputFormat::vtk_xml, "VTK", ".vtu .vts .vtr .vti .vtp", "", "", "a piece of a `.vtu`, else the file", "",
     "all but convex point sets and Bezier cells", "hidden, ghost and refined cells, texts, ids"},
    {InputFormat::vtk_parallel, "parallel VTK", ".pvtu .pvti .pvtr .pvts", "", "", "a piece", "", "as `.vtu`",
     "as `.vtu`"},
    {InputFormat::vtk_legacy, "legacy VTK", ".vtk", "", "to version 5.1", "the file", "", "as `.vtu`", "as `.vtu`"},
    {InputFormat::vtk_blocks, "VTK blocks", ".vtm .vtpd .vtpc", "", "nested; paths relative to the file",
     "a piece of a block", "", "as `.vtu`", "blocks with surfaces only"},
    {InputFormat::vtk_series, "VTK series", ".pvd .series", "", "`NAME.vtu.series` and others of ParaView", "a piece",
     "`--time`", "as its files", "other steps"},
    {InputFormat::vtkhdf, "VTKHDF", ".vtkhdf .hdf", "", "versions 1 and 2: unstructured grids, images", "a partition",
     "`--time`", "all of `.vtu` but polyhedra", "other types"},
    {InputFormat::plot3d, "PLOT3D", "", "a grid and its solution or functions",
     "a binary grid and its solution, or functions on it; their names in a `.nam` file", "all grids", "", "hexahedra",
     "blanked cells"},
    {InputFormat::exodus, "Exodus", ".e .exo .exii .ex2 .g .gen", "", "also `.e-s002` and `.e.4.0`",
     "a block, and the arrays of all points", "`--time`", "as VTK",
     "node sets, edge and face blocks; side sets without `--boundary`"},
    {InputFormat::cgns, "CGNS", ".cgns", "", "HDF5, ADF", "a zone", "`--time`", "as VTK",
     "sections of surfaces and boundary conditions without `--boundary`; flat zones; values of faces, edges and "
     "regions, discrete data"},
    {InputFormat::ensight, "EnSight", ".case .encas", "", "6, Gold; ascii, binary", "the whole mesh", "`--time`",
     "as VTK", "ghosts; materials; parts with surfaces only, without `--boundary`"},
    {InputFormat::openfoam, "OpenFOAM", ".foam", "a case's folder or .foam",
     "or a case's folder, also decomposed or collated; ascii, binary, `.gz`",
     "the mesh of a time step; decomposed: a processor, and all points on the outsides of processors", "`--time`",
     "polyhedra", "sets, zones, particles; patches without `--boundary`"},
    {InputFormat::gmsh, "Gmsh", ".msh", "", "2, 2.1, 2.2 and 4.1, ascii and binary", "the file and its mesh",
     "`--time`", "order 1 and 2",
     "periodic links, partitions, physical groups of curves and points; those of surfaces without "
     "`--boundary`"},
    {InputFormat::su2, "SU2", ".su2", ".su2 and its .csv", "and a `.csv` with its solution",
     "the mesh file and its mesh", "", "linear cells",
     "markers without `--boundary`; boxes that deform the mesh, periods"},
    {InputFormat::openvdb, "OpenVDB", ".vdb", "", "file versions 220 and later", "the grids of a file", "",
     "voxels and tiles, each its own box", "grids of other types"},
    {InputFormat::numpy, "NumPy", ".npy", "", "", "two pieces of 2^18 points", "", "none: scattered points",
     "columns called `_`"},
    {InputFormat::table, "tables", ".csv .tsv .txt", "",
     "texts of other names, too, if their first lines are a table, or with `--columns`",
     "two pieces of at most 2^18 lines", "", "none: scattered points", "columns of texts and ids, columns called `_`"},
}};

constexpr bool are_in_order() {
  for (std::size_t i = 0; i < rows.size(); ++i)
    if (static_cast<std::size_t>(rows[i].format) != i) return false;
  return true;
}
static_assert(are_in_order());

/// A grid of PLOT3D is known by its contents: these names are only usual.
constexpr std::string_view usual_names_of_plot3d = ".xyz .p3d .q";

/// Formats with data that are not read.
struct ForeignFormat {
  std::string_view name, extensions, way_out;
};
constexpr std::string_view by_paraview = "open it in ParaView, and save the data as .vtu";
constexpr std::array<ForeignFormat, 12> foreign_formats = {{
    {"XDMF", ".xdmf .xmf .xdmf3 .xmf3", by_paraview},
    {"Fluent", ".cas .cas.h5 .dat.h5 .cas.gz", by_paraview},
    {"HDF5", ".h5 .hdf5 .he5 .h5m",
     "open it in ParaView (most often by an .xdmf file beside it), and save the data as .vtu"},
    {"NetCDF", ".nc .nc4 .cdf", by_paraview},
    {"point clouds", ".las .laz .pcd .e57", "save the points as .csv: pdal translate IN OUT.csv"},
    {"MED", ".med", "open it in SALOME or ParaView, and save the data as .vtu"},
    {"Nek5000", ".nek5000", by_paraview},
    {"Tecplot", ".plt .szplt .tec", "open it in ParaView or VisIt, and save the data as .vtu"},
    {"CalculiX", ".frd", "convert it: ccx2paraview FILE.frd vtu"},
    {"Abaqus", ".inp .odb",
     "open its results in Abaqus or ParaView, and save the data as .vtu; meshes: meshio convert FILE.inp FILE.vtu"},
    {"I-DEAS", ".unv", "convert the mesh: meshio convert FILE.unv FILE.vtu"},
    {"LS-DYNA", ".d3plot", by_paraview},
}};

/// Whether a name, in lower case, ends with one of some extensions.
bool ends_in(std::string_view name, std::string_view extensions) {
  while (!extensions.empty()) {
    const std::size_t end = std::min(extensions.find(' '), extensions.size());
    if (name.ends_with(extensions.substr(0, end))) return true;
    extensions.remove_prefix(std::min(end + 1, extensions.size()));
  }
  return false;
}

std::optional<InputFormat> format_of_extension(std::string_view name) {
  const auto row =
      std::ranges::find_if(rows, [&](const FormatRow& format) { return ends_in(name, format.extensions); });
  return row != rows.end() ? std::optional(row->format) : std::nullopt;
}

const ForeignFormat* foreign_format_of(std::string_view path) {
  const std::string name = in_lower_case(std::string(path));
  const auto* found = std::ranges::find_if(
      foreign_formats, [&](const ForeignFormat& format) { return ends_in(name, format.extensions); });
  return found != foreign_formats.end() ? found : nullptr;
}

/// Removes `mark` and the digits behind it from the end of a name. Returns whether they were there.
bool cut_number(std::string_view& name, std::string_view mark) {
  const std::size_t last = name.find_last_not_of("0123456789");
  if (last == std::string_view::npos || last + 1 == name.size() || !name.substr(0, last + 1).ends_with(mark))
    return false;
  name = name.substr(0, last + 1 - mark.size());
  return true;
}

}  // namespace

const std::array<FormatRow, input_format_count>& input_formats() { return rows; }

std::string_view name_of(InputFormat format) { return rows[static_cast<std::size_t>(format)].name; }

std::string input_formats_for_help() {
  std::string text;
  for (const FormatRow& row : rows)
    text += fmt::format("{}{} ({})", text.empty() ? "" : ", ", row.name, row.help.empty() ? row.extensions : row.help);
  return text;
}

std::optional<InputFormat> format_of_name(std::string_view path) {
  if (path.ends_with("/system/controlDict")) return InputFormat::openfoam;
  const std::string lower = in_lower_case(std::string(path));
  std::string_view name = lower;
  if (const auto format = format_of_extension(name)) return format;
  const bool is_part = cut_number(name, ".") && cut_number(name, ".");
  const bool goes_on = cut_number(name, "-s");
  if (!is_part && !goes_on) return std::nullopt;
  return format_of_extension(name) == InputFormat::exodus ? std::optional(InputFormat::exodus) : std::nullopt;
}

bool is_file_series(std::string_view path) { return in_lower_case(std::string(path)).ends_with(".series"); }

bool is_foreign(std::string_view path) { return foreign_format_of(path) != nullptr; }

std::string way_out(std::string_view path) {
  const ForeignFormat* const format = foreign_format_of(path);
  return format ? fmt::format("files of {} are not read: {}", format->name, format->way_out) : std::string();
}

bool is_openfoam_case(const std::string& folder) {
  std::error_code ignored;
  return std::filesystem::exists(std::filesystem::path(folder) / "system" / "controlDict", ignored);
}

bool is_input_in_folder(const std::string& name) {
  return !name.starts_with('.') && format_of_name(name) && !has_extension(name, ".txt");
}

bool is_convertible(const std::string& path) {
  namespace fs = std::filesystem;
  std::error_code error;
  if (!fs::is_directory(path, error))
    return format_of_name(path) || is_foreign(path) || ends_in(in_lower_case(path), usual_names_of_plot3d);
  if (is_openfoam_case(path)) return true;
  for (fs::directory_iterator entry(path, error), end; !error && entry != end; entry.increment(error))
    if (is_input_in_folder(entry->path().filename())) return true;
  return false;
}

bool is_surface_file(std::string_view path) {
  return ends_in(in_lower_case(std::string(path)), ".stl .obj .ply .glb .gltf");
}

}  // namespace splatvol
