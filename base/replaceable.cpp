#include "base/replaceable.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <span>
#include <string_view>

#include "base/file.h"
#include "base/names.h"

namespace splatvol {
namespace {

constexpr std::uint64_t looked_at = 4096;  // an XML file may begin with a comment, a mark stands behind other bytes

using namespace std::string_view_literals;

// Each tells whether the first bytes of a file have the mark of an export.
using HasMark = bool (*)(std::string_view bytes);

bool vtk_has_mark(std::string_view bytes) {
  return bytes.substr(0, bytes.find("<VTKFile")).find(vtk_export_mark) != std::string_view::npos;
}

bool vdb_has_mark(std::string_view bytes) {
  if (bytes.size() < vdb_uuid_offset + vdb_uuid_bytes) return false;
  const std::string mark = vdb_export_mark(bytes.substr(vdb_uuid_offset, vdb_uuid_bytes));
  return bytes.find(mark) != std::string_view::npos;
}

bool stl_has_mark(std::string_view bytes) { return bytes.starts_with(stl_export_mark); }

bool glb_has_mark(std::string_view bytes) { return bytes.find(glb_export_mark) != std::string_view::npos; }

// The header of a .npy file has room for nothing but the array's description, and a .csv file has no other header.
bool has_no_mark(std::string_view /*bytes*/) { return false; }

/// A kind of file: by its extension and its first bytes. Of a text file, the first characters that are no white space.
/// Without `starts`, it may begin with anything.
struct FileKind {
  std::string_view extension;
  std::string_view name;
  std::array<std::string_view, 2> starts;
  HasMark has_mark = nullptr;  // of a kind that is also an input
};
constexpr std::array<FileKind, 12> kinds = {{{".svol", "a .svol file", {"\x89SVOL\r\n\x1a"sv}},
                                             {".png", "a PNG picture", {"\x89PNG\r\n\x1a\n"sv}},
                                             {".exr", "an OpenEXR picture", {"\x76\x2f\x31\x01"sv}},
                                             {".json", "JSON", {"{"sv, "["sv}},
                                             {".svols", "an index of .svol files", {"{"sv}},
                                             {".npy", "a .npy file", {"\x93NUMPY"sv}, has_no_mark},
                                             {".vdb", "an OpenVDB file", {" BDV"sv}, vdb_has_mark},
                                             {".vtu", "a VTK file", {"<?xml"sv, "<VTKFile"sv}, vtk_has_mark},
                                             {".vtp", "a VTK file", {"<?xml"sv, "<VTKFile"sv}, vtk_has_mark},
                                             {".glb", "a glTF file", {"glTF"sv}, glb_has_mark},
                                             {".stl", "an STL file", {}, stl_has_mark},
                                             {".csv", "a table", {}, has_no_mark}}};

bool is_of(const FileKind& kind, std::string_view bytes) {
  if (kind.starts[0].empty()) return true;
  const std::string_view text = bytes.substr(std::min(bytes.find_first_not_of(" \t\r\n"), bytes.size()));
  return std::ranges::any_of(kind.starts, [&](std::string_view start) {
    return !start.empty() && (bytes.starts_with(start) || text.starts_with(start));
  });
}

}  // namespace

std::string vdb_export_mark(std::string_view uuid) { return fmt::format("splatvol export {}", uuid); }

bool has_extension(const std::string& path, const std::string& extension) {
  return in_lower_case(std::filesystem::path(path).extension().string()) == extension;
}

Status check_replaceable(const std::string& path, Replace replace) {
  const auto kind = std::ranges::find_if(
      kinds, [&](const FileKind& known) { return has_extension(path, std::string(known.extension)); });
  std::error_code error;
  if (kind == kinds.end() || !std::filesystem::is_regular_file(path, error)) return {};
  SPLATVOL_TRY_ASSIGN(file, open_file(path));
  if (file->size() == 0) return {};
  std::string bytes(static_cast<std::size_t>(std::min(file->size(), looked_at)), '\0');
  SPLATVOL_TRY(file->read(0, std::as_writable_bytes(std::span(bytes))));
  if (!is_of(*kind, bytes))
    return fail(ErrorCode::invalid_argument, "{}: is there and is not {}: remove it, or give another name", path,
                kind->name);
  if (replace == Replace::any || kind->has_mark == nullptr || kind->has_mark(bytes)) return {};
  return fail(ErrorCode::invalid_argument,
              "{}: is there and may be an input of yours: give another name, or --force to replace it", path);
}

}  // namespace splatvol
