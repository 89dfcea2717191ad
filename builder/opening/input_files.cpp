#include "builder/opening/input_files.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <iterator>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <string_view>
#include <system_error>
#include <utility>

#include "base/file.h"
#include "base/input_formats.h"
#include "base/replaceable.h"
#include "builder/opening/formats.h"
#include "builder/sources/read_text.h"

namespace splatvol {
namespace {

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

/// Whether a file that no name tells to be an input holds data nevertheless. Parallel files of VTK's only name others.
bool holds_data(const std::string& path) {
  const auto start = read_text(path, 64);
  if (!start) return false;
  if (is_foreign(path)) return true;
  if (has_extension(path, ".txt")) return is_table(path);
  const auto header = read_header(path);
  if (header && header->format) return !header->type.starts_with('P') || header->type == "PolyData";
  return is_hdf5(*start);
}

struct Folder {
  std::vector<std::string> inputs;  // by their extensions
  std::vector<std::string> others;
};

/// A series names the files beside it, and tells their times: they are left to it if it is the only one of its kind.
/// ParaView writes a .series for each kind of files: several of these are no inputs.
void keep_series(Folder& folder) {
  const auto is_json = [](const std::string& name) { return is_file_series(name); };
  const auto is_series = [](const std::string& name) { return format_of_name(name) == InputFormat::vtk_series; };
  const bool has_pvd = std::ranges::any_of(
      folder.inputs, [&](const std::string& name) { return is_series(name) && !is_file_series(name); });
  if (has_pvd || std::ranges::count_if(folder.inputs, is_json) > 1) {
    const auto others = std::ranges::stable_partition(folder.inputs, std::not_fn(is_json));
    if (!has_pvd) folder.others.insert(folder.others.end(), others.begin(), others.end());
    folder.inputs.erase(others.begin(), others.end());
  }
  if (std::ranges::count_if(folder.inputs, is_series) == 1)
    folder = {{*std::ranges::find_if(folder.inputs, is_series)}, {}};
}

Result<Folder> list_folder(const std::string& path) {
  std::error_code error;
  Folder folder;
  for (std::filesystem::directory_iterator entry(path, error), end; !error && entry != end; entry.increment(error)) {
    const std::string name = entry->path().filename();
    if (!name.starts_with('.')) (is_input_in_folder(name) ? folder.inputs : folder.others).push_back(name);
  }
  if (error) return fail(ErrorCode::io, "{}: {}", path, error.message());
  keep_series(folder);
  // Names that differ only in leading zeros are compared by their bytes.
  for (std::vector<std::string>* names : {&folder.inputs, &folder.others})
    std::ranges::sort(*names, [](const std::string& a, const std::string& b) {
      return name_before(a, b) || (!name_before(b, a) && a < b);
    });
  return folder;
}

/// Takes ".NUMBER" off the end of a name. Returns its digits; none if there is no such end.
std::optional<std::string_view> take_number(std::string_view& name) {
  const std::size_t before = name.find_last_not_of("0123456789");
  if (before == std::string_view::npos || before + 1 == name.size() || name[before] != '.') return std::nullopt;
  const std::string_view digits = name.substr(before + 1);
  name = name.substr(0, before);
  return digits;
}

struct Pieces {
  std::string first;                // a path among them
  std::size_t digits = 0;           // of its number
  std::set<std::uint32_t> numbers;  // of those that are there
};

/// Fails if some pieces of a mesh are not among the files. Its pieces are NAME.N.0 to NAME.N.(N-1), where zeros may
/// stand before the last number. `paths`: of Exodus files; other names say nothing.
Status check_exodus_pieces(std::span<const std::string> paths) {
  std::map<std::pair<std::string, std::uint32_t>, Pieces> meshes;  // by name, and number of pieces
  for (const std::string& path : paths) {
    std::string_view name = path;
    const auto piece = take_number(name);
    const auto count = piece ? take_number(name) : std::nullopt;
    const auto number = piece ? number_of<std::uint32_t>(*piece) : std::nullopt,
               all = count ? number_of<std::uint32_t>(*count) : std::nullopt;
    if (!number || !all || *number >= *all) continue;
    Pieces& pieces = meshes[{std::string(name), *all}];
    if (pieces.first.empty()) pieces = {path, piece->size(), {}};
    pieces.numbers.insert(*number);
  }
  constexpr std::size_t most_named = 4;
  for (const auto& [mesh, pieces] : meshes) {
    std::vector<std::string> missing;
    for (std::uint32_t i = 0; i < mesh.second && missing.size() < most_named; ++i)
      if (!pieces.numbers.contains(i))
        missing.push_back(fmt::format("{}.{}.{:0{}}", mesh.first, mesh.second, i, pieces.digits));
    if (missing.empty()) continue;
    const std::size_t others = mesh.second - pieces.numbers.size() - missing.size();
    return fail(ErrorCode::invalid_data,
                "{}: the mesh has {} pieces, and {}{} missing: give all of them, or a piece by itself another name",
                pieces.first, mesh.second, fmt::join(missing, ", "),
                others > 0           ? fmt::format(" and {} more are", others)
                : missing.size() > 1 ? " are"
                                     : " is");
  }
  return {};
}

/// Whether an input stands for the files in it.
bool is_plain_folder(const std::string& input) {
  std::error_code error;
  return std::filesystem::is_directory(input, error) && !is_openfoam_case(input);
}

}  // namespace

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
                       [](const std::string& path) { return format_of_name(path) == InputFormat::exodus; });
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

}  // namespace splatvol
