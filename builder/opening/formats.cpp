#include "builder/opening/formats.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>

#include "base/file.h"
#include "base/names.h"
#include "base/replaceable.h"
#include "builder/sources/csv/csv_table.h"
#include "builder/sources/numpy/npy_header.h"
#include "builder/sources/openvdb/vdb_source.h"
#include "builder/sources/read_text.h"

namespace splatvol {
namespace {

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

/// Whether a text has two bytes a character: Windows's shell writes such files.
bool is_utf16(std::string_view text) {
  if (text.size() < 6) return false;
  return (text.starts_with("\xff\xfe") && text[3] == 0 && text[5] == 0) ||
         (text.starts_with("\xfe\xff") && text[2] == 0 && text[4] == 0);
}

}  // namespace

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

bool is_table(const std::string& path) {
  const auto file = open_file(path);
  return file && read_csv_table(**file, {});
}

}  // namespace splatvol
