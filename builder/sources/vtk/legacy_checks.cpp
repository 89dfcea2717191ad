#include "builder/sources/vtk/legacy_checks.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cstdint>
#include <memory>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

#include "base/file.h"
#include "builder/sources/vtk/file_words.h"

namespace splatvol {
namespace {

/// Bytes of a value in a binary file; 0 for types of no fixed size. VTK writes its own index type as int.
std::uint64_t bytes_of(const std::string& type) {
  constexpr std::array<std::pair<std::string_view, std::uint64_t>, 14> sizes = {{{"char", 1},
                                                                                 {"signed_char", 1},
                                                                                 {"unsigned_char", 1},
                                                                                 {"short", 2},
                                                                                 {"unsigned_short", 2},
                                                                                 {"int", 4},
                                                                                 {"unsigned_int", 4},
                                                                                 {"vtkidtype", 4},
                                                                                 {"long", 8},
                                                                                 {"unsigned_long", 8},
                                                                                 {"vtktypeint64", 8},
                                                                                 {"vtktypeuint64", 8},
                                                                                 {"float", 4},
                                                                                 {"double", 8}}};
  const auto* found = std::ranges::find(sizes, type, &std::pair<std::string_view, std::uint64_t>::first);
  return found == sizes.end() ? 0 : found->second;
}

/// Walks through the sections of one file.
class LegacyFile {
 public:
  explicit LegacyFile(std::unique_ptr<ByteSource> file) : words_(std::move(file)) {}

  /// Whether the file is whole, as far as its sections are known.
  bool walk() {
    const std::string version = words_.line();  // "# vtk DataFile Version 5.1"
    new_cells_ = version.find("Version 5") != std::string::npos;
    words_.line();
    binary_ = words_.next() == "binary";
    words_.line();
    while (!stopped_) {
      section_ = words_.next();
      if (section_.empty()) return true;
      if (!walk_section()) return false;
    }
    // The start of a keyword, at the very end.
    return !words_.at_end();
  }

  [[nodiscard]] const std::string& section() const { return section_; }

  /// Whether all is there, except for a line end after the last number.
  [[nodiscard]] bool has_open_end() const { return open_end_; }

 private:
  using Walk = bool (LegacyFile::*)();
  struct Section {
    std::string_view keyword;
    Walk walk;
  };

  bool walk_section() {
    static constexpr std::array<Section, 32> sections = {{{"dataset", &LegacyFile::one_word},
                                                          {"dimensions", &LegacyFile::three_words},
                                                          {"origin", &LegacyFile::three_words},
                                                          {"spacing", &LegacyFile::three_words},
                                                          {"aspect_ratio", &LegacyFile::three_words},
                                                          {"extent", &LegacyFile::six_words},
                                                          {"points", &LegacyFile::points},
                                                          {"x_coordinates", &LegacyFile::counted_values},
                                                          {"y_coordinates", &LegacyFile::counted_values},
                                                          {"z_coordinates", &LegacyFile::counted_values},
                                                          {"blanking", &LegacyFile::counted_values},
                                                          {"cells", &LegacyFile::cells},
                                                          {"vertices", &LegacyFile::cells},
                                                          {"lines", &LegacyFile::cells},
                                                          {"polygons", &LegacyFile::cells},
                                                          {"triangle_strips", &LegacyFile::cells},
                                                          {"cell_types", &LegacyFile::cell_types},
                                                          {"point_data", &LegacyFile::set_count},
                                                          {"cell_data", &LegacyFile::set_count},
                                                          {"scalars", &LegacyFile::scalars},
                                                          {"color_scalars", &LegacyFile::color_scalars},
                                                          {"lookup_table", &LegacyFile::lookup_table},
                                                          {"vectors", &LegacyFile::vectors},
                                                          {"normals", &LegacyFile::vectors},
                                                          {"texture_coordinates", &LegacyFile::texture_coordinates},
                                                          {"tensors", &LegacyFile::tensors},
                                                          {"tensors6", &LegacyFile::tensors6},
                                                          {"global_ids", &LegacyFile::ids},
                                                          {"pedigree_ids", &LegacyFile::ids},
                                                          {"edge_flags", &LegacyFile::ids},
                                                          {"field", &LegacyFile::field},
                                                          {"metadata", &LegacyFile::metadata}}};
    const auto* found = std::ranges::find(sections, section_, &Section::keyword);
    stopped_ = found == sections.end();
    return stopped_ || (this->*found->walk)();
  }

  bool one_word() { return words_.skip_words(1); }
  bool three_words() { return words_.skip_words(3); }
  bool six_words() { return words_.skip_words(6); }

  /// Reads a count. If it is no number, the walk stops, and VTK's reader tells.
  std::optional<std::uint64_t> count() {
    const std::string word = words_.next();
    std::uint64_t value = 0;
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (error == std::errc() && end == word.data() + word.size()) return value;
    stopped_ = true;
    return std::nullopt;
  }

  /// Whether `number` values of `parts` numbers each follow, after the rest of the line.
  bool values(std::uint64_t number, std::uint64_t parts, const std::string& type) {
    // More than one for each bit of the file cannot be there.
    if (parts > 0 && number > words_.size() * 8 / parts) return false;
    number *= parts;
    const bool text = type == "string" || type == "utf8_string";
    if (words_.line().empty() && words_.at_end() && number > 0) return false;
    if (text) return strings(number);
    if (!binary_) return text_values(number);
    if (type == "bit") return words_.skip_bytes((number + 7) / 8);
    const std::uint64_t bytes = bytes_of(type);
    stopped_ = bytes == 0;
    return stopped_ || words_.skip_bytes(number * bytes);
  }

  /// A text file may be cut within its last number: only white space tells that the number is whole.
  bool text_values(std::uint64_t number) {
    if (!words_.skip_words(number)) return false;
    open_end_ = number > 0 && words_.at_end();
    return !open_end_;
  }

  bool strings(std::uint64_t number) {
    for (; number > 0; --number) {
      if (words_.at_end()) return false;
      if (!binary_) {
        words_.line();
        continue;
      }
      // The two highest bits tell how many bytes the length has.
      const std::uint64_t first = words_.number(1);
      const std::size_t more = std::array<std::size_t, 4>{7, 3, 1, 0}[first >> 6];
      const std::uint64_t length = (first & 63) << (8 * more) | words_.number(more);
      if (!words_.skip_bytes(length)) return false;
    }
    return true;
  }

  bool points() {
    const auto number = count();
    return !number || values(*number, 3, words_.next());
  }

  bool counted_values() {
    const auto number = count();
    return !number || values(*number, 1, words_.next());
  }

  /// Before version 5, a list of counts and indices. Since then, an array of ends and an array of indices.
  bool cells() {
    const auto number = count();
    const auto size = number ? count() : std::nullopt;
    if (!size) return true;
    if (!new_cells_) return values(*size, 1, "int");
    for (const auto& [name, length] : {std::pair{"offsets", *number}, {"connectivity", *size}}) {
      const std::string word = words_.next();
      stopped_ = word != name && !words_.at_end();
      if (stopped_) return true;
      if (word != name || !values(length, 1, words_.next())) return false;
    }
    return true;
  }

  bool cell_types() {
    const auto number = count();
    return !number || values(*number, 1, "int");
  }

  bool set_count() {
    const auto number = count();
    data_count_ = number.value_or(0);
    return true;
  }

  bool named_values(std::uint64_t parts) { return words_.skip_words(1) && values(data_count_, parts, words_.next()); }
  bool vectors() { return named_values(3); }
  bool tensors() { return named_values(9); }
  bool tensors6() { return named_values(6); }
  bool ids() { return named_values(1); }

  /// SCALARS name type [components], then LOOKUP_TABLE name on a line of its own.
  bool scalars() {
    if (!words_.skip_words(1)) return false;
    const std::string type = words_.next();
    const std::string rest = words_.line();
    const std::size_t first = rest.find_first_of("123456789");
    const std::uint64_t parts = first == std::string::npos ? 1 : static_cast<std::uint64_t>(rest[first] - '0');
    if (words_.next() != "lookup_table") {
      stopped_ = !words_.at_end();
      return stopped_;
    }
    return words_.skip_words(1) && values(data_count_, parts, type);
  }

  bool color_scalars() {
    if (!words_.skip_words(1)) return false;
    const auto parts = count();
    return !parts || values(data_count_, *parts, "unsigned_char");
  }

  bool lookup_table() {
    if (!words_.skip_words(1)) return false;
    const auto number = count();
    return !number || values(*number, 4, "unsigned_char");
  }

  bool texture_coordinates() {
    if (!words_.skip_words(1)) return false;
    const auto parts = count();
    return !parts || values(data_count_, *parts, words_.next());
  }

  bool field() {
    if (!words_.skip_words(1)) return false;
    const auto arrays = count();
    for (std::uint64_t i = 0; arrays && i < *arrays && !stopped_; ++i) {
      std::string name = words_.next();
      if (name == "metadata") {
        if (!metadata()) return false;
        name = words_.next();
      }
      if (name.empty()) return false;
      const auto parts = count();
      const auto number = parts ? count() : std::nullopt;
      if (number && !values(*number, *parts, words_.next())) return false;
    }
    return true;
  }

  /// Ends at an empty line.
  bool metadata() {
    words_.line();
    while (!words_.at_end())
      if (const std::string line = words_.line(); std::ranges::all_of(line, is_white_space)) return true;
    return false;
  }

  FileWords words_;
  bool binary_ = false;
  bool new_cells_ = false;
  bool stopped_ = false;          // at something that is not known
  bool open_end_ = false;         // no white space after the last number
  std::uint64_t data_count_ = 0;  // of POINT_DATA or CELL_DATA
  std::string section_;
};

}  // namespace

Status check_legacy(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(file, open_file(path));
  LegacyFile legacy(std::move(file));
  if (legacy.walk()) return {};
  if (legacy.has_open_end())
    return fail(ErrorCode::invalid_data,
                "{}: no line end follows its last number: the file may be cut off; if it is "
                "whole, add a line end",
                path);
  std::string section = legacy.section();
  std::ranges::transform(section, section.begin(), [](unsigned char c) { return std::toupper(c); });
  return fail(ErrorCode::invalid_data, "{}: the file is cut off: it ends within its section {}", path,
              section.substr(0, 40));
}

}  // namespace splatvol
