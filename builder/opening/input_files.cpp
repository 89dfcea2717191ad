#include "builder/opening/input_files.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <filesystem>
#include <iterator>
#include <optional>
#include <string_view>

#include "base/file.h"
#include "base/names.h"
#include "base/replaceable.h"
#include "builder/opening/exodus_pieces.h"
#include "builder/sources/npy_header.h"
#include "builder/sources/read_text.h"
#include "builder/sources/vdb_source.h"
#include "builder/sources/vtk/netcdf_checks.h"

namespace splatvol {
namespace {

struct MultiBlockExtension {
  std::string_view extension;
  VtkFile::Kind kind;
};
constexpr std::array<MultiBlockExtension, 14> multi_block_extensions = {{{".e", VtkFile::Kind::exodus},
                                                                         {".exo", VtkFile::Kind::exodus},
                                                                         {".exii", VtkFile::Kind::exodus},
                                                                         {".ex2", VtkFile::Kind::exodus},
                                                                         {".g", VtkFile::Kind::exodus},
                                                                         {".gen", VtkFile::Kind::exodus},
                                                                         {".case", VtkFile::Kind::ensight},
                                                                         {".encas", VtkFile::Kind::ensight},
                                                                         {".foam", VtkFile::Kind::openfoam},
                                                                         {".cgns", VtkFile::Kind::cgns},
                                                                         {".msh", VtkFile::Kind::gmsh},
                                                                         {".su2", VtkFile::Kind::su2},
                                                                         {".vtkhdf", VtkFile::Kind::vtkhdf},
                                                                         {".hdf", VtkFile::Kind::vtkhdf}}};

/// Removes `mark` and the digits behind it from the end of a name. Returns whether they were there.
bool cut_number(std::string_view& name, std::string_view mark) {
  const std::size_t last = name.find_last_not_of("0123456789");
  if (last == std::string_view::npos || last + 1 == name.size() || !name.substr(0, last + 1).ends_with(mark))
    return false;
  name = name.substr(0, last + 1 - mark.size());
  return true;
}

/// Finds the format of a multi-block file by its name, in either case: most of these files are HDF5 or plain text. An
/// Exodus file that holds a part of a mesh has a name such as "mesh.e.4.0", one of a run that went on "mesh.e-s002".
std::optional<VtkFile::Kind> multi_block_kind(std::string_view path) {
  const auto kind_of = [](std::string_view name) -> std::optional<VtkFile::Kind> {
    const auto found = std::ranges::find_if(
        multi_block_extensions, [&](const MultiBlockExtension& known) { return name.ends_with(known.extension); });
    return found == multi_block_extensions.end() ? std::nullopt : std::optional(found->kind);
  };
  if (path.ends_with("/system/controlDict")) return VtkFile::Kind::openfoam;
  const std::string lower = in_lower_case(std::string(path));
  std::string_view name = lower;
  if (const auto kind = kind_of(name)) return kind;
  const bool is_part = cut_number(name, ".") && cut_number(name, ".");
  const bool goes_on = cut_number(name, "-s");
  if (!is_part && !goes_on) return std::nullopt;
  return kind_of(name) == VtkFile::Kind::exodus ? kind_of(name) : std::nullopt;
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

bool is_known(const std::string& name) {
  return has_vtk_extension(name) || multi_block_kind(name) || has_extension(name, ".npy") ||
         has_extension(name, ".vdb") || is_csv(name);
}

/// Whether a file that no name tells to be an input holds data nevertheless. Parallel files of VTK's only name others.
bool holds_data(const std::string& path) {
  constexpr std::array<std::string_view, 18> extensions = {".h5",  ".hdf5", ".he5", ".h5m", ".xdmf",    ".xmf",
                                                           ".nc",  ".nc4",  ".cdf", ".med", ".plt",     ".szplt",
                                                           ".tec", ".frd",  ".inp", ".unv", ".nek5000", ".d3plot"};
  const auto file = open_file(path);
  if (!file) return false;
  const std::string name = in_lower_case(std::string(path));
  if (std::ranges::any_of(extensions, [&](std::string_view extension) { return name.ends_with(extension); }))
    return true;
  const auto header = read_header(path);
  if (header && header->format != FileHeader::Format::other)
    return !header->type.starts_with('P') || header->type == "PolyData";
  const auto start = read_text(**file, 0, 64);
  return start && is_hdf5(*start);
}

/// The names in a folder.
struct Folder {
  std::vector<std::string> inputs;  // by their extensions
  std::vector<std::string> others;
};

Result<Folder> list_folder(const std::string& path) {
  std::error_code error;
  Folder folder;
  for (std::filesystem::directory_iterator entry(path, error), end; !error && entry != end; entry.increment(error)) {
    const std::string name = entry->path().filename();
    if (!name.starts_with('.')) (is_known(name) ? folder.inputs : folder.others).push_back(name);
  }
  if (error) return fail(ErrorCode::io, "{}: {}", path, error.message());
  // A .pvd names the files beside it, and tells their times.
  const auto is_pvd = [](const std::string& name) { return has_extension(name, ".pvd"); };
  if (std::ranges::count_if(folder.inputs, is_pvd) == 1) folder = {{*std::ranges::find_if(folder.inputs, is_pvd)}, {}};
  // Names that differ only in leading zeros are compared by their bytes.
  for (std::vector<std::string>* names : {&folder.inputs, &folder.others})
    std::ranges::sort(*names, [](const std::string& a, const std::string& b) {
      return name_before(a, b) || (!name_before(b, a) && a < b);
    });
  return folder;
}

/// Whether an input stands for the files in it.
bool is_plain_folder(const std::string& input) {
  std::error_code error;
  return std::filesystem::is_directory(input, error) &&
         !std::filesystem::exists(std::filesystem::path(input) / "system" / "controlDict", error);
}

}  // namespace

bool is_csv(std::string_view path) {
  const std::string name(path);
  return has_extension(name, ".csv") || has_extension(name, ".tsv");
}

bool has_vtk_extension(std::string_view path) {
  constexpr std::array<std::string_view, 11> extensions = {".vtu", ".pvtu", ".vtk", ".vts",  ".vtr", ".vti",
                                                           ".vtp", ".pvd",  ".vtm", ".vtpd", ".vtpc"};
  const std::string name = in_lower_case(std::string(path));
  return std::ranges::any_of(extensions, [&](std::string_view extension) { return name.ends_with(extension); });
}

Result<FileHeader> read_header(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(file, open_file(path));
  SPLATVOL_TRY_ASSIGN(text, read_text(*file, 0, 65536));

  FileHeader header;
  if (text.starts_with(npy_magic) || has_extension(path, ".npy")) {
    header.format = FileHeader::Format::npy;
    return header;
  }
  if (is_csv(path)) {
    header.format = FileHeader::Format::csv;
    return header;
  }
  if (text.starts_with(vdb_magic) || has_extension(path, ".vdb")) {
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

Result<std::vector<std::string>> expand_folders(const std::vector<std::string>& inputs) {
  std::vector<std::string> paths;
  for (const std::string& input : inputs) {
    if (!is_plain_folder(input)) {
      std::error_code error;
      const auto control = std::filesystem::path(input) / "system" / "controlDict";
      paths.push_back(std::filesystem::is_directory(input, error) ? control.string() : input);
      continue;
    }
    SPLATVOL_TRY_ASSIGN(folder, list_folder(input));
    if (folder.inputs.empty())
      return fail(ErrorCode::invalid_data, "{}: a folder without files that can be read", input);
    for (const std::string& name : folder.inputs) paths.push_back((std::filesystem::path(input) / name).string());
  }
  std::vector<std::string> exodus;
  std::ranges::copy_if(paths, std::back_inserter(exodus),
                       [](const std::string& path) { return multi_block_kind(path) == VtkFile::Kind::exodus; });
  SPLATVOL_TRY(check_exodus_pieces(exodus));
  return paths;
}

std::vector<std::string> files_left_out(const std::vector<std::string>& inputs) {
  std::vector<std::string> paths;
  for (const std::string& input : inputs) {
    if (!is_plain_folder(input)) continue;
    const auto folder = list_folder(input);
    if (!folder) continue;  // expand_folders() tells
    for (const std::string& name : folder->others)
      if (const auto path = std::filesystem::path(input) / name; holds_data(path)) paths.push_back(path.string());
  }
  return paths;
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
