#include "builder/open_source.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <filesystem>
#include <optional>
#include <set>
#include <string_view>

#include "base/file.h"
#include "builder/sources/csv_source.h"
#include "builder/sources/generator.h"
#include "builder/sources/npy_header.h"
#include "builder/sources/npy_source.h"
#include "builder/sources/read_text.h"
#include "builder/sources/time_steps.h"
#include "builder/sources/vdb_source.h"
#include "builder/sources/vtk/collections.h"
#include "builder/sources/vtk/netcdf_checks.h"
#include "builder/sources/vtk/reader.h"
#include "builder/sources/vtk/source.h"

namespace splatvol {
namespace {

/// The format of a file, by its first bytes and its name.
struct FileHeader {
  enum class Format { vtk_xml, vtk_legacy, multi_block, npy, csv, vdb, other };
  Format format = Format::other;
  VtkFile::Kind kind = VtkFile::Kind::unstructured;  // of a multi-block file
  std::string type;                                  // of an XML file: "UnstructuredGrid", ...
  int major = 0;
  int minor = 0;
};

struct XmlType {
  std::string_view name;
  VtkFile::Kind kind;
};
constexpr std::array<XmlType, 5> xml_types = {{{"UnstructuredGrid", VtkFile::Kind::unstructured},
                                               {"StructuredGrid", VtkFile::Kind::structured},
                                               {"RectilinearGrid", VtkFile::Kind::rectilinear},
                                               {"ImageData", VtkFile::Kind::image},
                                               {"PolyData", VtkFile::Kind::poly}}};

bool has_vtk_extension(std::string_view path) {
  constexpr std::array<std::string_view, 11> extensions = {".vtu", ".pvtu", ".vtk", ".vts",  ".vtr", ".vti",
                                                           ".vtp", ".pvd",  ".vtm", ".vtpd", ".vtpc"};
  return std::ranges::any_of(extensions, [&](std::string_view extension) { return path.ends_with(extension); });
}

struct MultiBlockExtension {
  std::string_view extension;
  VtkFile::Kind kind;
};
constexpr std::array<MultiBlockExtension, 13> multi_block_extensions = {{{".e", VtkFile::Kind::exodus},
                                                                         {".exo", VtkFile::Kind::exodus},
                                                                         {".exii", VtkFile::Kind::exodus},
                                                                         {".ex2", VtkFile::Kind::exodus},
                                                                         {".g", VtkFile::Kind::exodus},
                                                                         {".case", VtkFile::Kind::ensight},
                                                                         {".encas", VtkFile::Kind::ensight},
                                                                         {".foam", VtkFile::Kind::openfoam},
                                                                         {".cgns", VtkFile::Kind::cgns},
                                                                         {".msh", VtkFile::Kind::gmsh},
                                                                         {".su2", VtkFile::Kind::su2},
                                                                         {".vtkhdf", VtkFile::Kind::vtkhdf},
                                                                         {".hdf", VtkFile::Kind::vtkhdf}}};

/// Finds the format of a multi-block file by its name: most of these files are HDF5 or plain text. An Exodus file that
/// holds a part of a mesh has a name such as "mesh.e.4.0".
std::optional<VtkFile::Kind> multi_block_kind(std::string_view path) {
  const auto kind_of = [](std::string_view name) -> std::optional<VtkFile::Kind> {
    const auto found = std::ranges::find_if(
        multi_block_extensions, [&](const MultiBlockExtension& known) { return name.ends_with(known.extension); });
    return found == multi_block_extensions.end() ? std::nullopt : std::optional(found->kind);
  };
  if (path.ends_with("/system/controlDict")) return VtkFile::Kind::openfoam;
  if (const auto kind = kind_of(path)) return kind;
  for (int i = 0; i < 2; ++i) {
    const std::size_t last = path.find_last_not_of("0123456789");
    if (last == std::string_view::npos || last + 1 == path.size() || path[last] != '.') return std::nullopt;
    path = path.substr(0, last);
  }
  return kind_of(path) == VtkFile::Kind::exodus ? kind_of(path) : std::nullopt;
}

bool is_csv(std::string_view path) {
  return path.ends_with(".csv") || path.ends_with(".CSV") || path.ends_with(".tsv");
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
  FileHeader header;
  header.format = FileHeader::Format::vtk_legacy;
  if (!parse_version(text.substr(legacy_start.size()), header))
    return fail(ErrorCode::invalid_data, "{}: the version in its first line is not a number", path);
  return header;
}

/// `element`: the start tag of the VTKFile element.
Result<FileHeader> read_xml_header(const std::string& path, std::string element) {
  // White space of any kind may separate XML attributes.
  std::ranges::replace_if(
      element, [](char c) { return c == '\n' || c == '\r' || c == '\t'; }, ' ');
  FileHeader header;
  header.format = FileHeader::Format::vtk_xml;
  header.type = xml_attribute(element, "type");
  const std::string version = xml_attribute(element, "version");
  if (!version.empty() && !parse_version(version, header))
    return fail(ErrorCode::invalid_data, "{}: the version \"{}\" of its VTKFile element is not a number", path,
                version);
  return header;
}

Result<FileHeader> read_header(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(file, open_file(path));
  SPLATVOL_TRY_ASSIGN(text, read_text(*file, 0, 65536));

  FileHeader header;
  if (text.starts_with(npy_magic) || path.ends_with(".npy")) {
    header.format = FileHeader::Format::npy;
    return header;
  }
  if (is_csv(path)) {
    header.format = FileHeader::Format::csv;
    return header;
  }
  if (text.starts_with(vdb_magic) || path.ends_with(".vdb")) {
    header.format = FileHeader::Format::vdb;
    return header;
  }
  // Exodus files in NetCDF's own format may have any name.
  if (const auto kind = is_netcdf(text) ? VtkFile::Kind::exodus : multi_block_kind(path)) {
    header.format = FileHeader::Format::multi_block;
    header.kind = *kind;
    return header;
  }
  if (text.starts_with(legacy_start)) return read_legacy_header(path, text);
  const std::size_t tag = text.find("<VTKFile");
  if (tag == std::string::npos) return header;
  return read_xml_header(path, text.substr(tag, text.find('>', tag) - tag));
}

bool newer_than(const FileHeader& header, int major, int minor) {
  return header.major > major || (header.major == major && header.minor > minor);
}

tl::unexpected<Error> fail_version(const std::string& path, const FileHeader& header, const char* newest) {
  return fail(ErrorCode::unsupported,
              "{}: file version {}.{} is newer than {}, the newest that this version reads right", path, header.major,
              header.minor, newest);
}

/// Checks the version here, because VTK at most warns of a newer major version, and reads what it recognises. The
/// polyhedra of version 2.3 are read by builder/sources/vtk/unstructured_reader.cpp.
Result<VtkFile> identify_xml(const std::string& path, const FileHeader& header) {
  const auto type = std::ranges::find(xml_types, header.type, &XmlType::name);
  if (type == xml_types.end())
    return fail(ErrorCode::unsupported, "{}: VTK files of type \"{}\" are not supported", path, header.type);
  if (newer_than(header, 2, 3)) return fail_version(path, header, "2.3");
  return VtkFile{path, type->kind};
}

/// Appends the pieces that a .pvtu names.
Status append_pieces(const std::string& path, std::vector<VtkFile>& files) {
  SPLATVOL_TRY_ASSIGN(pieces, pvtu_pieces(path));
  for (const std::string& piece : pieces) {
    const auto header = read_header(piece);
    if (!header) return fail_in(path, header.error());
    if (header->format != FileHeader::Format::vtk_xml || header->type != "UnstructuredGrid")
      return fail(ErrorCode::invalid_data, "{}: its piece {} is not a .vtu file", path, piece);
    SPLATVOL_TRY_ASSIGN(file, identify_xml(piece, *header));
    files.push_back(file);
  }
  return {};
}

/// A file that names files is not one of those that it names, at any depth.
constexpr int deepest_nesting = 16;

Status append_file(const std::string& path, std::vector<VtkFile>& files, int nesting = 0);

bool is_composite(const FileHeader& header) {
  constexpr std::array<std::string_view, 3> types = {"vtkMultiBlockDataSet", "vtkPartitionedDataSet",
                                                     "vtkPartitionedDataSetCollection"};
  return std::ranges::find(types, header.type) != types.end();
}

/// Appends a file that names the files of its blocks. Errors of these begin with its name.
Status append_composite(const std::string& path, std::vector<VtkFile>& files, int nesting) {
  if (nesting == deepest_nesting) return fail(ErrorCode::invalid_data, "{}: files name each other too deeply", path);
  SPLATVOL_TRY_ASSIGN(names, block_files(path));
  VtkFile composite{path, VtkFile::Kind::composite};
  for (const std::string& name : names)
    if (const Status added = append_file(name, composite.blocks, nesting + 1); !added)
      return fail_in(path, added.error());
  files.push_back(std::move(composite));
  return {};
}

Status append_file(const std::string& path, std::vector<VtkFile>& files, int nesting) {
  SPLATVOL_TRY_ASSIGN(header, read_header(path));
  if (header.format == FileHeader::Format::npy)
    return fail(ErrorCode::invalid_argument, "{}: a .npy file among meshes", path);
  if (header.format == FileHeader::Format::csv)
    return fail(ErrorCode::invalid_argument, "{}: a .csv file among meshes", path);
  if (header.format == FileHeader::Format::vdb)
    return fail(ErrorCode::invalid_argument, "{}: a .vdb file among meshes", path);
  if (header.format == FileHeader::Format::other)
    return fail(ErrorCode::invalid_data, "{}: not a VTK file (neither \"<VTKFile\" nor \"# vtk DataFile\" in it)",
                path);
  if (header.format == FileHeader::Format::multi_block) {
    files.push_back({path, header.kind});
    return {};
  }
  if (header.format == FileHeader::Format::vtk_legacy) {
    if (newer_than(header, 5, 1)) return fail_version(path, header, "5.1");
    files.push_back({path, VtkFile::Kind::legacy});
    return {};
  }
  if (header.type == "PUnstructuredGrid") return append_pieces(path, files);
  if (is_composite(header)) return append_composite(path, files, nesting);
  if (header.type == "Collection") return fail(ErrorCode::invalid_argument, "{}: a .pvd must be the only input", path);
  SPLATVOL_TRY_ASSIGN(file, identify_xml(path, header));
  files.push_back(file);
  return {};
}

/// Compares names with numbers by size: "piece2" comes before "piece10".
bool name_before(std::string_view a, std::string_view b) {
  const auto is_digit = [](char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; };
  while (!a.empty() && !b.empty()) {
    std::string_view part_a = a.substr(0, 1), part_b = b.substr(0, 1);
    if (is_digit(a[0]) && is_digit(b[0])) {
      part_a = a.substr(0, static_cast<std::size_t>(std::ranges::find_if_not(a, is_digit) - a.begin()));
      part_b = b.substr(0, static_cast<std::size_t>(std::ranges::find_if_not(b, is_digit) - b.begin()));
    }
    a.remove_prefix(part_a.size());
    b.remove_prefix(part_b.size());
    // Without leading zeros, the longer of two numbers is the larger.
    part_a.remove_prefix(std::min(part_a.find_first_not_of('0'), part_a.size() - 1));
    part_b.remove_prefix(std::min(part_b.find_first_not_of('0'), part_b.size() - 1));
    if (part_a.size() != part_b.size()) return part_a.size() < part_b.size();
    if (part_a != part_b) return part_a < part_b;
  }
  return a.size() < b.size();
}

/// Lists the files in a folder that can be read, by their extensions.
Result<std::vector<std::string>> list_folder(const std::string& folder) {
  std::error_code error;
  std::vector<std::string> names;
  for (std::filesystem::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    const std::string name = entry->path().filename();
    const bool known = has_vtk_extension(name) || multi_block_kind(name) || name.ends_with(".npy") ||
                       name.ends_with(".vdb") || is_csv(name);
    if (known && !name.starts_with('.')) names.push_back(name);
  }
  if (error) return fail(ErrorCode::io, "{}: {}", folder, error.message());
  if (names.empty()) return fail(ErrorCode::invalid_data, "{}: a folder without files that can be read", folder);
  // A .pvd names the files beside it, and tells their times.
  const auto is_pvd = [](const std::string& name) { return name.ends_with(".pvd"); };
  if (std::ranges::count_if(names, is_pvd) == 1) names = {*std::ranges::find_if(names, is_pvd)};
  // Names that differ only in leading zeros are compared by their bytes.
  std::ranges::sort(names, [](const std::string& a, const std::string& b) {
    return name_before(a, b) || (!name_before(b, a) && a < b);
  });
  std::vector<std::string> paths;
  for (const std::string& name : names) paths.push_back((std::filesystem::path(folder) / name).string());
  return paths;
}

/// Replaces folders by the files in them. An OpenFOAM case is a folder, but one input.
Result<std::vector<std::string>> files_of(const std::vector<std::string>& inputs) {
  std::vector<std::string> paths;
  for (const std::string& input : inputs) {
    std::error_code error;
    if (!std::filesystem::is_directory(input, error)) {
      paths.push_back(input);
      continue;
    }
    const auto control = std::filesystem::path(input) / "system" / "controlDict";
    if (std::filesystem::exists(control, error)) {
      paths.push_back(control.string());
      continue;
    }
    SPLATVOL_TRY_ASSIGN(files, list_folder(input));
    paths.insert(paths.end(), files.begin(), files.end());
  }
  return paths;
}

std::string normal_path(const VtkFile& file) { return std::filesystem::path(file.path).lexically_normal().string(); }

void collect_blocks(const VtkFile& file, std::set<std::string>& paths) {
  for (const VtkFile& block : file.blocks) {
    paths.insert(normal_path(block));
    collect_blocks(block, paths);
  }
}

/// Drops repeated files: a folder may hold a .pvtu or .vtm and the files that it names.
void drop_repeated(std::vector<VtkFile>& files) {
  std::set<std::string> seen;
  for (const VtkFile& file : files) collect_blocks(file, seen);
  std::erase_if(files, [&](const VtkFile& file) { return !seen.insert(normal_path(file)).second; });
}

/// Replaces a .pvd by the files of its step nearest to `time`, without a time the last. Returns the step, or nothing if
/// the input is no .pvd.
Result<std::optional<TimeStep>> expand_pvd(std::vector<std::string>& paths, const FileHeader& first,
                                           std::optional<double> time) {
  if (first.type != "Collection" || paths.size() != 1) return std::optional<TimeStep>();
  SPLATVOL_TRY_ASSIGN(steps, pvd_steps(paths[0]));
  std::vector<double> times;
  for (const auto& of_collection : steps) times.push_back(of_collection.time);
  std::optional<TimeStep> step = choose_step(times, time);
  const std::string collection = paths[0];
  paths = steps[step->index].files;
  for (const std::string& path : paths)
    if (const auto header = read_header(path); !header) return fail_in(collection, header.error());
  return step;
}

tl::unexpected<Error> fail_no_cells(const std::string& input) {
  return fail(ErrorCode::invalid_argument,
              "{}: its values belong to points or voxels; leave out '--cells own', which is for meshes in files",
              input);
}

Result<std::unique_ptr<Source>> open_any(const std::vector<std::string>& inputs, const SourceOptions& options) {
  const auto generated = std::ranges::find_if(inputs, is_generated);
  if (generated != inputs.end() && inputs.size() > 1)
    return fail(ErrorCode::invalid_argument, "{}: must be the only input", *generated);
  if (generated != inputs.end() && options.cells == CellValues::own) return fail_no_cells(*generated);
  if (generated != inputs.end()) return open_generated(*generated, options);

  SPLATVOL_TRY_ASSIGN(paths, files_of(inputs));
  if (paths.empty()) return fail(ErrorCode::invalid_argument, "no input file");
  SPLATVOL_TRY_ASSIGN(first, read_header(paths[0]));
  if (options.cells == CellValues::own &&
      (first.format == FileHeader::Format::npy || first.format == FileHeader::Format::csv ||
       first.format == FileHeader::Format::vdb))
    return fail_no_cells(paths[0]);
  if (first.format == FileHeader::Format::npy) return open_npy_files(paths, options);
  if (first.format == FileHeader::Format::csv) return open_csv_files(paths, options);
  if (!options.columns.empty())
    return fail(ErrorCode::invalid_argument, "{}: neither a .npy nor a .csv file, so its columns cannot be named",
                paths[0]);
  const MissingValues missing(options.missing);
  if (first.format == FileHeader::Format::vdb) return open_vdb_files(paths, options.selection, missing);
  if (first.format == FileHeader::Format::other && !has_vtk_extension(paths[0])) {
    if (paths.size() == 2) return open_plot3d(paths[0], paths[1], options.selection, options.cells, missing);
    return fail(
        ErrorCode::invalid_argument,
        "{}: neither a VTK nor a .npy nor a .vdb file; a PLOT3D grid needs its solution as the second of two files",
        paths[0]);
  }

  SPLATVOL_TRY_ASSIGN(step, expand_pvd(paths, first, options.time));
  std::vector<VtkFile> files;
  for (std::size_t i = 0; i < paths.size(); ++i) {
    SPLATVOL_TRY(append_file(paths[i], files));
    // A .csv behind an SU2 mesh holds its values.
    if (files.back().kind == VtkFile::Kind::su2 && i + 1 < paths.size() && is_csv(paths[i + 1]))
      files.back().values = paths[++i];
  }
  if (paths != inputs) drop_repeated(files);
  if (files.empty()) return fail(ErrorCode::invalid_data, "{}: names no pieces", paths[0]);
  return open_vtk_files(std::move(files), options.selection, options.time, options.cells, missing, step);
}

}  // namespace

Result<std::vector<std::string>> expand_folders(const std::vector<std::string>& inputs) { return files_of(inputs); }

Result<std::unique_ptr<Source>> open_source(const std::vector<std::string>& inputs, const SourceOptions& options) {
  SPLATVOL_TRY_ASSIGN(source, open_any(inputs, options));
  if (options.time && !source->time_step())
    return fail(ErrorCode::invalid_argument, "{}: no time steps in it to choose from", inputs[0]);
  return source;
}

int usual_up(const std::vector<std::string>& inputs) {
  std::error_code ignored;
  for (const std::string& input : inputs)
    if (multi_block_kind(input) == VtkFile::Kind::openfoam ||
        std::filesystem::exists(std::filesystem::path(input) / "system" / "controlDict", ignored))
      return 2;
  return -1;
}

}  // namespace splatvol
