#include "builder/sources/formats.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>

#include "base/file.h"
#include "base/names.h"
#include "base/replaceable.h"
#include "builder/sources/csv_table.h"
#include "builder/sources/npy_header.h"
#include "builder/sources/read_text.h"
#include "builder/sources/vdb_source.h"

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

std::string xml_attribute(std::string_view element, std::string_view name) {
  for (const char quote : {'"', '\''}) {
    const std::string start = fmt::format(" {}={}", name, quote);
    const std::size_t at = element.find(start);
    if (at == std::string_view::npos) continue;
    const std::size_t first = at + start.size();
    return std::string(element.substr(first, element.find(quote, first) - first));
  }
  return {};
}

bool parse_version(std::string_view text, FileHeader& header) {
  const char* end = text.data() + text.size();
  const auto major = std::from_chars(text.data(), end, header.major);
  if (major.ec != std::errc{} || major.ptr == end || *major.ptr != '.') return false;
  return std::from_chars(major.ptr + 1, end, header.minor).ec == std::errc{};
}

constexpr std::string_view legacy_start = "# vtk DataFile Version ";

Result<FileHeader> read_legacy_header(const std::string& path, std::string_view text) {
  FileHeader header{.format = InputFormat::vtk_legacy};
  if (!parse_version(text.substr(legacy_start.size()), header))
    return fail(ErrorCode::invalid_data, "{}: the version in its first line is not a number", path);
  return header;
}

InputFormat format_of_xml(std::string_view type) {
  if (is_one_of(type, {"vtkMultiBlockDataSet", "vtkPartitionedDataSet", "vtkPartitionedDataSetCollection"}))
    return InputFormat::vtk_blocks;
  if (type == "Collection") return InputFormat::vtk_series;
  if (is_one_of(type, {"PUnstructuredGrid", "PImageData", "PRectilinearGrid", "PStructuredGrid"}))
    return InputFormat::vtk_parallel;
  return InputFormat::vtk_xml;
}

/// `element`: the start tag of the VTKFile element.
Result<FileHeader> read_xml_header(const std::string& path, std::string element) {
  // White space of any kind may separate XML attributes.
  std::ranges::replace_if(
      element, [](char c) { return c == '\n' || c == '\r' || c == '\t'; }, ' ');
  FileHeader header{.type = xml_attribute(element, "type")};
  header.format = format_of_xml(header.type);
  const std::string version = xml_attribute(element, "version");
  if (!version.empty() && !parse_version(version, header))
    return fail(ErrorCode::invalid_data, "{}: the version \"{}\" of its VTKFile element is not a number", path,
                version);
  return header;
}

/// Formats that their names tell: most of their files are HDF5 or plain text.
bool is_known_by_name(InputFormat format) { return format >= InputFormat::vtkhdf; }

}  // namespace

const std::array<FormatRow, input_format_count>& input_formats() { return rows; }

std::string_view name_of(InputFormat format) { return rows[static_cast<std::size_t>(format)].name; }

std::string input_formats_for_help() {
  std::string text;
  for (const FormatRow& row : rows)
    text += fmt::format("{}{} ({})", text.empty() ? "" : ", ", row.name, row.help.empty() ? row.extensions : row.help);
  return text;
}

std::string input_formats_for_page() {
  std::string text =
      "| format | extensions | files | held at once | time steps | cells | left out |\n|---|---|---|---|---|---|---|\n";
  const auto add = [&](std::string_view words) { text += words.empty() ? " |" : fmt::format(" {} |", words); };
  for (const FormatRow& row : rows) {
    text += "|";
    add(row.name);
    add(row.extensions.empty() ? "any" : fmt::format("`{}`", row.extensions));
    for (const std::string_view words : {row.files, row.held, row.steps, row.cells, row.left_out}) add(words);
    text += "\n";
  }
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

namespace {

/// Whether a text has two bytes a character: Windows's shell writes such files.
bool is_utf16(std::string_view text) {
  if (text.size() < 6) return false;
  return (text.starts_with("\xff\xfe") && text[3] == 0 && text[5] == 0) ||
         (text.starts_with("\xfe\xff") && text[2] == 0 && text[4] == 0);
}

}  // namespace

tl::unexpected<Error> fail_byte_order_mark(const std::string& path) {
  return fail(ErrorCode::invalid_data,
              "{}: a byte order mark stands in front of the text, and VTK's reader takes it for a word: remove it by "
              "sed '1s/^\\xef\\xbb\\xbf//' {} > OUT",
              path, path);
}

Result<FileHeader> read_header(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(text, read_text(path, 65536));
  if (text.starts_with(std::string_view("\xec\x2b\x08\x00", 4)))
    return fail(
        ErrorCode::unsupported,
        "{}: a binary solution of SU2: write it as a table, by OUTPUT_FILES= RESTART_ASCII in SU2's configuration",
        path);
  if (text.starts_with("version https://git-lfs."))
    return fail(ErrorCode::invalid_data, "{}: a pointer of Git LFS instead of the file: get it by 'git lfs pull'",
                path);
  if (is_utf16(text))
    return fail(ErrorCode::invalid_data, "{}: a text in UTF-16: save it as UTF-8, or iconv -f UTF-16 -t UTF-8 {} > OUT",
                path, path);
  const std::optional<InputFormat> named = format_of_name(path);
  if (is_file_series(path)) return FileHeader{.format = InputFormat::vtk_series};
  if (text.starts_with(npy_magic)) return FileHeader{.format = InputFormat::numpy};
  const bool is_text = has_extension(path, ".txt");  // of any format
  if (named == InputFormat::numpy || (named == InputFormat::table && !is_text)) return FileHeader{.format = named};
  if (text.starts_with(vdb_magic)) return FileHeader{.format = InputFormat::openvdb};
  // Exodus files in NetCDF's own format may have any name. Others have no dimension of this name.
  if (is_netcdf(text) && (!is_foreign(path) || text.find("num_nodes") != std::string::npos))
    return FileHeader{.format = InputFormat::exodus};
  if (text.starts_with(byte_order_mark) &&
      (named == InputFormat::ensight || without_byte_order_mark(text).starts_with(legacy_start)))
    return fail_byte_order_mark(path);
  if (named && is_known_by_name(*named) && !is_text) return FileHeader{.format = named};
  if (text.starts_with(legacy_start)) return read_legacy_header(path, text);
  const std::size_t tag = text.find("<VTKFile");
  if (tag == std::string::npos)
    return is_text || (!is_foreign(path) && is_table(path)) ? FileHeader{.format = InputFormat::table} : FileHeader{};
  return read_xml_header(path, text.substr(tag, text.find('>', tag) - tag));
}

bool is_file_series(std::string_view path) { return in_lower_case(std::string(path)).ends_with(".series"); }

bool is_table(const std::string& path) {
  const auto file = open_file(path);
  return file && read_csv_table(**file, {});
}

bool is_foreign(std::string_view path) { return foreign_format_of(path) != nullptr; }

std::string way_out(std::string_view path) {
  const ForeignFormat* const format = foreign_format_of(path);
  return format ? fmt::format("files of {} are not read: {}", format->name, format->way_out) : std::string();
}

}  // namespace splatvol
