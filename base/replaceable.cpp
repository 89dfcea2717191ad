#include "base/replaceable.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <filesystem>
#include <span>
#include <string_view>

#include "base/file.h"

namespace splatvol {
namespace {

constexpr std::uint64_t looked_at = 4096;  // an XML file may begin with a comment

using namespace std::string_view_literals;

/// A kind of file: by its extension and its first bytes. Of a text file, the first characters that are no white space.
struct FileKind {
  std::string_view extension;
  std::string_view name;
  std::array<std::string_view, 2> starts;
};
constexpr std::array<FileKind, 8> kinds = {{{".svol", "a .svol file", {"\x89SVOL\r\n\x1a"sv}},
                                            {".png", "a PNG picture", {"\x89PNG\r\n\x1a\n"sv}},
                                            {".exr", "an OpenEXR picture", {"\x76\x2f\x31\x01"sv}},
                                            {".json", "JSON", {"{"sv, "["sv}},
                                            {".svols", "an index of .svol files", {"{"sv}},
                                            {".npy", "a .npy file", {"\x93NUMPY"sv}},
                                            {".vdb", "an OpenVDB file", {" BDV"sv}},
                                            {".vtu", "a VTK file", {"<?xml"sv, "<VTKFile"sv}}}};

bool is_of(const FileKind& kind, std::string_view bytes) {
  const std::string_view text = bytes.substr(std::min(bytes.find_first_not_of(" \t\r\n"), bytes.size()));
  return std::ranges::any_of(kind.starts, [&](std::string_view start) {
    return !start.empty() && (bytes.starts_with(start) || text.starts_with(start));
  });
}

}  // namespace

bool has_extension(const std::string& path, const std::string& extension) {
  std::string of_path = std::filesystem::path(path).extension().string();
  std::ranges::transform(of_path, of_path.begin(), [](unsigned char c) { return std::tolower(c); });
  return of_path == extension;
}

Status check_replaceable(const std::string& path) {
  const auto kind = std::ranges::find_if(
      kinds, [&](const FileKind& known) { return has_extension(path, std::string(known.extension)); });
  std::error_code error;
  if (kind == kinds.end() || !std::filesystem::is_regular_file(path, error)) return {};
  SPLATVOL_TRY_ASSIGN(file, open_file(path));
  if (file->size() == 0) return {};
  std::string bytes(std::min(file->size(), looked_at), '\0');
  SPLATVOL_TRY(file->read(0, std::as_writable_bytes(std::span(bytes))));
  if (is_of(*kind, bytes)) return {};
  return fail(ErrorCode::invalid_argument, "{}: is there and is not {}: remove it, or give another name", path,
              kind->name);
}

}  // namespace splatvol
