#include "builder/sources/vtk/legacy_checks.h"

#include <fmt/format.h>

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
#include "base/printable.h"
#include "builder/sources/array_attributes.h"
#include "builder/sources/array_union.h"
#include "builder/sources/file_words.h"
#include "builder/sources/read_text.h"

namespace splatvol {
namespace {

constexpr std::int64_t largest_side = 1 << 20;  // points of a grid along an axis, so that products do not overflow

/// Bytes of a value in a binary file; 0 for types of no fixed size. VTK writes its own index type as int.
std::uint64_t bytes_of(const std::string& type) {
  if (is_one_of(type, {"char", "signed_char", "unsigned_char"})) return 1;
  if (is_one_of(type, {"short", "unsigned_short"})) return 2;
  if (is_one_of(type, {"int", "unsigned_int", "vtkidtype", "float"})) return 4;
  return is_one_of(type, {"long", "unsigned_long", "vtktypeint64", "vtktypeuint64", "double"}) ? 8 : 0;
}

/// Walks through the sections of one file.
class LegacyFile {
 public:
  explicit LegacyFile(std::unique_ptr<ByteSource> file) : words_(std::move(file)) {}

  /// Whether the file is whole, and its sections fit together.
  bool walk() {
    const std::string version = words_.line();  // "# vtk DataFile Version 5.1"
    const std::size_t number = version.find("Version ");
    new_cells_ = number != std::string::npos && version.compare(number + 8, 2, "5.") == 0;
    words_.line();
    binary_ = words_.next() == "binary";
    words_.line();
    for (;;) {
      section_ = words_.next();
      if (section_.empty()) return check_sizes();
      if (!walk_section()) return false;
    }
  }

  [[nodiscard]] const std::string& section() const { return section_; }

  /// Whether all is there, except for a line end after the last number.
  [[nodiscard]] bool has_open_end() const { return open_end_; }

  /// The arrays of a file that has been walked through.
  [[nodiscard]] const std::vector<ArrayShape>& shapes() const { return shapes_; }

  /// Names the parts that do not fit together; empty if the file is cut off.
  [[nodiscard]] const std::string& damage() const { return damage_; }

 private:
  using Walk = bool (LegacyFile::*)();
  struct Section {
    std::string_view keyword;
    Walk walk;
  };

  bool walk_section() {
    static constexpr std::array<Section, 32> sections = {{{"dataset", &LegacyFile::dataset},
                                                          {"dimensions", &LegacyFile::dimensions},
                                                          {"origin", &LegacyFile::three_numbers},
                                                          {"spacing", &LegacyFile::three_numbers},
                                                          {"aspect_ratio", &LegacyFile::three_numbers},
                                                          {"extent", &LegacyFile::extent},
                                                          {"points", &LegacyFile::points},
                                                          {"x_coordinates", &LegacyFile::coordinates<0>},
                                                          {"y_coordinates", &LegacyFile::coordinates<1>},
                                                          {"z_coordinates", &LegacyFile::coordinates<2>},
                                                          {"blanking", &LegacyFile::counted_values},
                                                          {"cells", &LegacyFile::cells},
                                                          {"vertices", &LegacyFile::surface_cells},
                                                          {"lines", &LegacyFile::surface_cells},
                                                          {"polygons", &LegacyFile::surface_cells},
                                                          {"triangle_strips", &LegacyFile::surface_cells},
                                                          {"cell_types", &LegacyFile::cell_types},
                                                          {"point_data", &LegacyFile::begin_data<false>},
                                                          {"cell_data", &LegacyFile::begin_data<true>},
                                                          {"scalars", &LegacyFile::scalars},
                                                          {"color_scalars", &LegacyFile::color_scalars},
                                                          {"lookup_table", &LegacyFile::lookup_table},
                                                          {"vectors", &LegacyFile::named<3>},
                                                          {"normals", &LegacyFile::named<3>},
                                                          {"texture_coordinates", &LegacyFile::texture_coordinates},
                                                          {"tensors", &LegacyFile::named<9>},
                                                          {"tensors6", &LegacyFile::named<6>},
                                                          {"global_ids", &LegacyFile::ids},
                                                          {"pedigree_ids", &LegacyFile::ids},
                                                          {"edge_flags", &LegacyFile::named<1>},
                                                          {"field", &LegacyFile::field},
                                                          {"metadata", &LegacyFile::metadata}}};
    const auto* found = std::ranges::find(sections, section_, &Section::keyword);
    if (found != sections.end()) return (this->*found->walk)();
    // At the very end, it is the start of a keyword.
    if (words_.at_end()) return false;
    for (char& c : section_) c = c >= ' ' && c <= '~' ? c : '?';
    return refuse("an unknown section");
  }

  /// Notes what is wrong. Returns false.
  bool refuse(std::string damage) {
    damage_ = std::move(damage);
    return false;
  }

  bool dataset() {
    kind_ = words_.next();
    if (is_one_of(kind_, {"structured_points", "structured_grid", "rectilinear_grid", "unstructured_grid", "polydata"}))
      return true;
    return !words_.at_end() && refuse("a data set that is no mesh");
  }

  bool three_numbers() { return numbers(3); }

  bool numbers(std::uint64_t count) {
    if (words_.skip_numbers(count) == count) return true;
    return !words_.at_end() && refuse("a word instead of a number");
  }

  bool dimensions() {
    dimensions_.emplace();
    for (std::uint64_t& side : *dimensions_) {
      const auto number = count();
      if (!number) return false;
      side = *number;
    }
    return set_grid_points();
  }

  bool extent() {
    dimensions_.emplace();
    for (std::uint64_t& side : *dimensions_) {
      const auto first = integer(), last = first ? integer() : std::nullopt;
      if (!last) return false;
      if (*last < *first || *last - *first >= largest_side) return refuse("a wrong extent");
      side = static_cast<std::uint64_t>(*last - *first) + 1;
    }
    return set_grid_points();
  }

  bool set_grid_points() {
    grid_points_ = 1;
    for (const std::uint64_t side : *dimensions_) {
      if (side > static_cast<std::uint64_t>(largest_side)) return refuse("too many points along an axis");
      *grid_points_ *= side;
    }
    return true;
  }

  /// Reads an integer of a line of text.
  std::optional<std::int64_t> integer() {
    const std::string word = words_.next();
    const auto value = number_of<std::int64_t>(word);
    if (!value && !words_.at_end()) refuse("a word instead of a number");
    return value;
  }

  std::optional<std::uint64_t> count() {
    const auto value = integer();
    if (value && *value >= 0) return static_cast<std::uint64_t>(*value);
    if (value) refuse("a negative count");
    return std::nullopt;
  }

  /// Notes an array of `parts` numbers for each element. VTK takes memory for the names of all, also if there are no
  /// elements.
  bool add_array(std::uint64_t parts) {
    if (!attributes_.add(parts)) return refuse(fmt::format("more than {} attributes", AttributeCount::most));
    return ++arrays_ <= most_vtk_arrays || refuse(fmt::format("more than {} arrays", most_vtk_arrays));
  }

  static bool is_text(std::string_view type) { return type == "string" || type == "utf8_string"; }

  /// Whether `number` values of `parts` numbers each follow, after the rest of the line.
  bool values(std::uint64_t number, std::uint64_t parts, const std::string& type) {
    // More than one for each bit of the file cannot be there.
    if (parts > 0 && number > words_.size() * 8 / parts) return false;
    number *= parts;
    const bool text = is_text(type);
    const bool known = text || type == "bit" || bytes_of(type) > 0;
    if (!known) return !words_.at_end() && refuse("numbers of an unknown type");
    if (words_.line().empty() && words_.at_end() && number > 0) return false;
    if (text) return strings(number);
    if (!binary_) return text_values(number);
    if (type == "bit") return words_.skip_bytes((number + 7) / 8);
    return words_.skip_bytes(number * bytes_of(type));
  }

  /// A text file may be cut within its last number: only white space tells that the number is whole.
  bool text_values(std::uint64_t number) { return numbers(number) && close_text(number); }

  bool close_text(std::uint64_t number) {
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
    points_ = count();
    return points_ && values(*points_, 3, words_.next());
  }

  bool counted_values() {
    const auto number = count();
    return number && values(*number, 1, words_.next());
  }

  template <std::size_t axis>
  bool coordinates() {
    const auto number = count();
    if (!number) return false;
    if (dimensions_ && *number != (*dimensions_)[axis]) return refuse("coordinates that do not fit the dimensions");
    return values(*number, 1, words_.next());
  }

  bool cells() {
    const bool whole = read_cells();
    cells_ = bad_points_.size();
    return whole;
  }

  bool surface_cells() {
    if (!read_cells()) return false;
    const bool bad = std::ranges::find(bad_points_, true) != bad_points_.end();
    return !bad || refuse("cells that name points which are not there");
  }

  /// Before version 5, a list of counts and indices. Since then, an array of ends and an array of indices.
  bool read_cells() {
    bad_points_.clear();
    bad_faces_.clear();
    const auto number = count();
    const auto size = number ? count() : std::nullopt;
    if (!size) return false;
    // Each number takes a byte at least.
    if (*number > words_.size() || *size > words_.size()) return false;
    return new_cells_ ? read_ends_and_indices(*number, *size) : read_counts_and_indices(*number, *size);
  }

  bool read_counts_and_indices(std::uint64_t number, std::uint64_t size) {
    if (words_.line().empty() && words_.at_end() && number > 0) return false;
    for (std::uint64_t used = 0; number > 0; --number) {
      const auto length = index(4);
      if (!length) return false;
      if (*length < 0 || static_cast<std::uint64_t>(*length) + 1 > size - std::min(used, size))
        return refuse("cells that are longer than the section");
      used += static_cast<std::uint64_t>(*length) + 1;
      if (!read_cell(static_cast<std::uint64_t>(*length), 4)) return false;
      if (number == 1 && used != size) return refuse("cells that are shorter than the section");
    }
    return binary_ || close_text(size);
  }

  bool read_ends_and_indices(std::uint64_t number, std::uint64_t size) {
    std::vector<std::uint64_t> ends;
    const auto bytes = array_of("offsets");
    for (std::uint64_t i = 0; bytes && i < number; ++i) {
      const auto end = index(*bytes);
      if (!end) return false;
      const std::uint64_t before = ends.empty() ? 0 : ends.back();
      ends.push_back(static_cast<std::uint64_t>(*end));
      if (*end < 0 || ends.back() < before || ends.back() > size || (i == 0 && *end != 0))
        return refuse("offsets of cells that do not rise from 0 to the number of indices");
    }
    const auto index_bytes = bytes ? array_of("connectivity") : std::nullopt;
    if (!index_bytes) return false;
    if (size != (ends.empty() ? 0 : ends.back()))
      return refuse("offsets of cells that do not rise from 0 to the number of indices");
    for (std::size_t i = 1; i < ends.size(); ++i)
      if (!read_cell(ends[i] - ends[i - 1], *index_bytes)) return false;
    return binary_ || close_text(size);
  }

  /// Reads the name of an array of indices, and the bytes of each in a binary file.
  std::optional<std::uint64_t> array_of(std::string_view name) {
    const bool named = words_.next() == name;
    const std::uint64_t bytes = named ? bytes_of(words_.next()) : 0;
    words_.line();
    if (words_.at_end()) return std::nullopt;
    if (bytes == 4 || bytes == 8) return bytes;
    refuse("cells without offsets or connectivity");
    return std::nullopt;
  }

  /// Reads a number of a list of cells, of `bytes` bytes if the file is binary.
  std::optional<std::int64_t> index(std::uint64_t bytes) {
    if (!binary_) return integer();
    if (bytes > words_.size() - std::min(words_.offset(), words_.size())) return std::nullopt;
    const std::uint64_t number = words_.number(bytes);
    return bytes == 4 ? static_cast<std::int32_t>(number) : static_cast<std::int64_t>(number);
  }

  /// Reads the points of a cell. For a polyhedron they are the number of faces, and for each face its points and their
  /// number. The type of the cell follows later.
  bool read_cell(std::uint64_t length, std::uint64_t bytes) {
    const auto is_point = [&](std::int64_t i) {
      return i >= 0 && (!points_ || static_cast<std::uint64_t>(i) < *points_);
    };
    bool bad_points = false, bad_faces = false;
    std::int64_t faces = 0, of_face = 0;  // still to come
    for (std::uint64_t i = 0; i < length; ++i) {
      const auto number = index(bytes);
      if (!number) return false;
      bad_points = bad_points || !is_point(*number);
      if (i == 0) {
        faces = *number;
      } else if (of_face == 0) {
        of_face = *number;
        --faces;
        bad_faces = bad_faces || *number < 3;
      } else {
        bad_faces = bad_faces || !is_point(*number);
        --of_face;
      }
      bad_faces = bad_faces || faces < 0 || of_face < 0;
    }
    bad_points_.push_back(bad_points);
    bad_faces_.push_back(bad_faces || faces != 0 || of_face != 0 || length == 0);
    return true;
  }

  bool cell_types() {
    constexpr std::int64_t polyhedron = 42, largest_type = 255;
    const auto number = count();
    if (!number) return false;
    if (*number != cells_) return refuse(fmt::format("{} types for {} cells", *number, cells_));
    if (words_.line().empty() && words_.at_end() && *number > 0) return false;
    for (std::uint64_t cell = 0; cell < *number; ++cell) {
      const auto type = index(4);
      if (!type) return false;
      if (*type < 0 || *type > largest_type) return refuse(fmt::format("a cell of type {}", *type));
      if (*type == polyhedron && bad_faces_[cell]) return refuse("a polyhedron whose faces are damaged");
      if (*type != polyhedron && bad_points_[cell]) return refuse("a cell that names a point which is not there");
    }
    typed_ = true;
    return binary_ || close_text(*number);
  }

  template <bool of_cells>
  bool begin_data() {
    of_cells_ = of_cells;
    const auto number = count();
    data_count_ = number.value_or(0);
    return number.has_value();
  }

  /// Whether the numbers of points fit together.
  bool check_sizes() {
    if (grid_points_ && kind_ == "structured_grid" && points_ && *points_ != *grid_points_)
      return refuse(fmt::format("{} points for a grid of {}", *points_, *grid_points_));
    return kind_ != "unstructured_grid" || cells_ == 0 || typed_ || refuse("cells without types");
  }

  template <std::uint64_t parts>
  bool named() {
    const std::string name = words_.name(), type = words_.next();
    return named_values(name, parts, type);
  }
  bool named_values(const std::string& name, std::uint64_t parts, const std::string& type) {
    return !name.empty() && add_array(parts) && note_shape(name, parts, type) && values(data_count_, parts, type);
  }
  bool ids() { return words_.skip_words(1) && add_array(1) && values(data_count_, 1, words_.next()); }

  /// Notes the shape of an array of the points or cells that may give attributes. Returns true.
  bool note_shape(const std::string& name, std::uint64_t parts, const std::string& type) {
    if (of_cells_ && !is_text(type))
      shapes_.push_back({as_utf8(decoded(name)), static_cast<int>(std::max<std::uint64_t>(parts, 1)), *of_cells_});
    return true;
  }

  /// Names have white space as "%20".
  static std::string decoded(const std::string& name) {
    std::string plain;
    for (std::size_t i = 0; i < name.size(); ++i) {
      unsigned int code = 0;
      const char* digits = name.data() + i + 1;
      const bool coded =
          name[i] == '%' && i + 2 < name.size() && std::from_chars(digits, digits + 2, code, 16).ptr == digits + 2;
      plain += coded ? static_cast<char>(code) : name[i];
      i += coded ? 2 : 0;
    }
    return plain;
  }

  /// SCALARS name type [components], then LOOKUP_TABLE name on a line of its own.
  bool scalars() {
    const std::string name = words_.name(), type = words_.next();
    const std::string rest = words_.line();
    const std::size_t first = std::min(rest.find_first_not_of(" \t\r"), rest.size());
    std::uint64_t parts = 1;
    if (first < rest.size()) std::from_chars(rest.data() + first, rest.data() + rest.size(), parts);
    if (words_.next() != "lookup_table") return !words_.at_end() && refuse("scalars without a line LOOKUP_TABLE");
    return words_.skip_words(1) && named_values(name, parts, type);
  }

  bool color_scalars() {
    const std::string name = words_.name();
    const auto parts = count();
    return parts && named_values(name, *parts, "unsigned_char");
  }

  bool lookup_table() {
    if (!words_.skip_words(1)) return false;
    const auto number = count();
    return number && values(*number, 4, "unsigned_char");
  }

  bool texture_coordinates() {
    const std::string name = words_.name();
    const auto parts = count();
    return parts && named_values(name, *parts, words_.next());
  }

  bool field() {
    if (!words_.skip_words(1)) return false;
    const auto arrays = count();
    if (arrays && *arrays > AttributeCount::most) return add_array(*arrays);
    for (std::uint64_t i = 0; arrays && i < *arrays; ++i) {
      std::string name = words_.name();
      if (is_metadata(name)) {
        if (!metadata()) return false;
        name = words_.name();
      }
      if (name.empty()) return false;
      const auto parts = count();
      const auto number = parts ? count() : std::nullopt;
      if (!number || !add_array(*parts)) return false;
      const std::string type = words_.next();
      if (!note_shape(name, *parts, type) || !values(*number, *parts, type)) return false;
    }
    return arrays.has_value();
  }

  static bool is_metadata(std::string_view word) {
    constexpr std::string_view keyword = "metadata";
    return std::ranges::equal(word, keyword, [](unsigned char a, char b) { return std::tolower(a) == b; });
  }

  /// Ends at an empty line, or with the file behind all that it declares: INFORMATION and a number of entries, each a
  /// line NAME and a line DATA, or names of components.
  bool metadata() {
    constexpr std::string_view information = "INFORMATION ";
    words_.line();
    std::uint64_t lines_left = 1;
    while (!words_.at_end()) {
      const std::string text = words_.line();
      const std::string_view line = trimmed(text);
      if (line.empty()) return true;
      if (line.starts_with(information))
        lines_left = 2 * std::uint64_t{number_of<std::uint32_t>(line.substr(information.size())).value_or(1)};
      else if (line == "COMPONENT_NAMES")
        lines_left = 0;
      else if (line.starts_with("NAME ") || line.starts_with("DATA "))
        lines_left -= std::min<std::uint64_t>(lines_left, 1);
    }
    return lines_left == 0 && words_.ended_line();
  }

  FileWords words_;
  bool binary_ = false;
  bool new_cells_ = false;
  std::string damage_;
  std::string kind_;              // of the data set
  bool open_end_ = false;         // no white space after the last number
  std::uint64_t data_count_ = 0;  // of POINT_DATA or CELL_DATA
  std::optional<bool> of_cells_;  // that is CELL_DATA; none before these sections
  std::vector<ArrayShape> shapes_;
  AttributeCount attributes_;
  std::size_t arrays_ = 0;
  std::string section_;

  std::optional<std::uint64_t> points_;
  std::optional<std::array<std::uint64_t, 3>> dimensions_;
  std::optional<std::uint64_t> grid_points_;  // by dimensions_
  std::uint64_t cells_ = 0;                   // of an unstructured grid
  bool typed_ = false;                        // its cells
  std::vector<bool> bad_points_;              // [cell] of the last section of cells: names points that are not there
  std::vector<bool> bad_faces_;               // [cell]: is no polyhedron
};

}  // namespace

Result<std::vector<ArrayShape>> legacy_arrays(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(file, open_file(path));
  LegacyFile legacy(std::move(file));
  if (legacy.walk()) return legacy.shapes();
  if (legacy.has_open_end())
    return fail(ErrorCode::invalid_data,
                "{}: no line end follows its last number: the file may be cut off; if it is "
                "whole, add a line end",
                path);
  std::string section = legacy.section();
  std::ranges::transform(section, section.begin(), [](unsigned char c) { return std::toupper(c); });
  section.resize(std::min<std::size_t>(section.size(), 40));
  if (!legacy.damage().empty())
    return fail(ErrorCode::invalid_data, "{}: the file is damaged: {} (section {})", path, legacy.damage(), section);
  return fail(ErrorCode::invalid_data, "{}: the file is cut off: it ends within its section {}", path, section);
}

}  // namespace splatvol
