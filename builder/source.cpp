#include "builder/source.h"

#include <algorithm>
#include <charconv>
#include <optional>
#include <span>
#include <string_view>

#include "base/file.h"
#include "builder/vtk_reader.h"
#include "builder/vtk_source.h"

namespace splatvol {
namespace {

/// What the first bytes of a file say that it is.
struct FileHeader {
  enum class Format { vtk_xml, vtk_legacy, other };
  Format format = Format::other;
  std::string type;  // of an XML file: "UnstructuredGrid", ...
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
  constexpr std::array<std::string_view, 7> extensions = {".vtu", ".pvtu", ".vtk", ".vts", ".vtr", ".vti", ".vtp"};
  return std::ranges::any_of(extensions, [&](std::string_view extension) { return path.ends_with(extension); });
}

std::string attribute_of(std::string_view element, std::string_view name) {
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

Result<FileHeader> read_header(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(file, open_file(path));
  std::string text(std::min<std::uint64_t>(file->size(), 65536), '\0');
  SPLATVOL_TRY(file->read(0, std::as_writable_bytes(std::span(text))));

  FileHeader header;
  constexpr std::string_view legacy_start = "# vtk DataFile Version ";
  if (text.starts_with(legacy_start)) {
    header.format = FileHeader::Format::vtk_legacy;
    if (!parse_version(std::string_view(text).substr(legacy_start.size()), header))
      return fail(ErrorCode::invalid_data, "{}: the version in its first line is not a number", path);
    return header;
  }
  const std::size_t at = text.find("<VTKFile");
  if (at == std::string::npos) return header;

  // White space of any kind may separate an element's attributes.
  std::string element = text.substr(at, text.find('>', at) - at);
  std::ranges::replace_if(
      element, [](char c) { return c == '\n' || c == '\r' || c == '\t'; }, ' ');
  header.format = FileHeader::Format::vtk_xml;
  header.type = attribute_of(element, "type");
  const std::string version = attribute_of(element, "version");
  if (!version.empty() && !parse_version(version, header))
    return fail(ErrorCode::invalid_data, "{}: the version \"{}\" of its VTKFile element is not a number", path,
                version);
  return header;
}

bool newer_than(const FileHeader& header, int major, int minor) {
  return header.major > major || (header.major == major && header.minor > minor);
}

tl::unexpected<Error> fail_version(const std::string& path, const FileHeader& header, const char* newest) {
  return fail(ErrorCode::unsupported,
              "{}: file version {}.{} is newer than {}, the newest that this version reads right", path, header.major,
              header.minor, newest);
}

/// VTK warns of a newer major version at most, and reads what it recognises; so the version is judged here. What 2.3
/// brought, polyhedra in arrays of their own, vtk_unstructured_reader.cpp reads by itself.
Result<VtkFile> identify_xml(const std::string& path, const FileHeader& header) {
  const auto type = std::ranges::find(xml_types, header.type, &XmlType::name);
  if (type == xml_types.end())
    return fail(ErrorCode::unsupported, "{}: VTK files of type \"{}\" are not supported", path, header.type);
  if (newer_than(header, 2, 3)) return fail_version(path, header, "2.3");
  return VtkFile{path, type->kind};
}

Status append_file(const std::string& path, std::vector<VtkFile>& files) {
  SPLATVOL_TRY_ASSIGN(header, read_header(path));
  if (header.format == FileHeader::Format::other)
    return fail(ErrorCode::invalid_data, "{}: not a VTK file (neither \"<VTKFile\" nor \"# vtk DataFile\" in it)",
                path);
  if (header.format == FileHeader::Format::vtk_legacy) {
    if (newer_than(header, 5, 1)) return fail_version(path, header, "5.1");
    files.push_back({path, VtkFile::Kind::legacy});
    return {};
  }
  if (header.type == "PUnstructuredGrid") {
    SPLATVOL_TRY_ASSIGN(pieces, pvtu_pieces(path));
    for (const std::string& piece : pieces) {
      const auto piece_result = read_header(piece);
      if (!piece_result) return fail_in(path, piece_result.error());
      const FileHeader& piece_header = *piece_result;
      if (piece_header.format != FileHeader::Format::vtk_xml || piece_header.type != "UnstructuredGrid")
        return fail(ErrorCode::invalid_data, "{}: its piece {} is not a .vtu file", path, piece);
      SPLATVOL_TRY_ASSIGN(file, identify_xml(piece, piece_header));
      files.push_back(file);
    }
    return {};
  }
  SPLATVOL_TRY_ASSIGN(file, identify_xml(path, header));
  files.push_back(file);
  return {};
}

}  // namespace

CellCensus& CellCensus::operator+=(const CellCensus& other) {
  for (const auto& [name, count] : other.cells) cells[name] += count;
  tetrahedra += other.tetrahedra;
  inverted += other.inverted;
  flat += other.flat;
  without_volume += other.without_volume;
  hidden += other.hidden;
  non_finite += other.non_finite;
  not_star_shaped += other.not_star_shaped;
  return *this;
}

Result<std::unique_ptr<Source>> open_source(const std::vector<std::string>& paths,
                                            const std::vector<std::string>& selection) {
  if (paths.empty()) return fail(ErrorCode::invalid_argument, "no input file");
  SPLATVOL_TRY_ASSIGN(first, read_header(paths[0]));
  if (first.format == FileHeader::Format::other && !has_vtk_extension(paths[0])) {
    if (paths.size() == 2) return open_plot3d(paths[0], paths[1], selection);
    return fail(ErrorCode::invalid_argument,
                "{}: not a VTK file; a PLOT3D grid needs its solution as the second of two files", paths[0]);
  }

  std::vector<VtkFile> files;
  for (const std::string& path : paths) SPLATVOL_TRY(append_file(path, files));
  if (files.empty()) return fail(ErrorCode::invalid_data, "{}: names no pieces", paths[0]);
  return open_vtk_files(std::move(files), selection);
}

}  // namespace splatvol
