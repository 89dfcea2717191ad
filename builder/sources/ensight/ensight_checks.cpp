#include "builder/sources/ensight/ensight_checks.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <limits>
#include <map>
#include <memory>
#include <string_view>
#include <utility>
#include <vector>

#include "base/file.h"
#include "builder/sources/array_attributes.h"
#include "builder/sources/file_words.h"
#include "builder/sources/read_text.h"
#include "builder/sources/time_steps.h"

namespace splatvol {
namespace {

constexpr std::size_t text_bytes = 80;       // of a line in a binary file
constexpr std::uint32_t part_limit = 65536;  // VTK's, by which it finds the order of bytes, too

/// How all files of a case are written. Only its geometry tells.
struct EnsightEncoding {
  bool binary = false;
  bool fortran = false;                 // a length before and after each record
  std::optional<bool> little_endian{};  // once known
};

/// Whether a program wrote this instead of a number: Fortran writes stars where a number is wider than its columns,
/// Microsoft's C library "1.#IND" or "1.#QNAN" for one that is none.
bool is_unwritten(std::string_view word) {
  return !word.empty() && (word.find_first_not_of('*') == std::string_view::npos || word.find(".#") < word.size());
}

/// Numbers and lines of one file, text or binary. `ended()` tells that a read failed: the file ended, or `odd()` stands
/// where a number must be.
class EnsightReader {
 public:
  EnsightReader(std::unique_ptr<ByteSource> file, EnsightEncoding encoding)
      : words_(std::move(file)), encoding_(encoding) {}

  /// Finds the encoding by the first line of a geometry.
  void find_encoding() {
    const std::string start = words_.bytes(text_bytes);
    words_.move_to(0);
    const std::size_t kind = start.find("Binary");
    if (kind == std::string::npos || kind > 20) return;
    encoding_ = {true, start.find("Fortran") != std::string::npos};
    line();
  }

  [[nodiscard]] const EnsightEncoding& encoding() const { return encoding_; }

  [[nodiscard]] bool ended() const { return ended_; }
  [[nodiscard]] bool has_open_end() const { return open_end_; }
  [[nodiscard]] const std::optional<std::string>& odd() const { return odd_; }
  [[nodiscard]] bool at_end() {
    if (!encoding_.binary) words_.skip_white_space();
    return words_.at_end();
  }

  /// For a file that lacks something.
  void end() { ended_ = true; }

  [[nodiscard]] std::uint64_t size() const { return words_.size(); }

  /// A line as it is; empty at the end of the file.
  std::string line() {
    if (words_.at_end()) return {};
    if (!encoding_.binary) {
      std::string line = words_.line();
      open_end_ = open_end_ || !words_.ended_line();
      return line;
    }
    mark();
    std::string line = words_.bytes(text_bytes);
    mark();
    ended_ = ended_ || line.size() < text_bytes;
    return line.substr(0, line.find('\0'));
  }

  /// A line without comment and white space that is not empty; empty at the end of the file.
  std::string keyword() {
    std::string word;
    while (word.empty() && !words_.at_end() && !ended_) word = bare_case_line(line());
    if (open_end_ && word != "END TIME STEP") ended_ = true;
    return word;
  }

  /// `count` numbers of one record, or line.
  std::vector<std::uint32_t> counts(std::size_t count) {
    std::vector<std::uint32_t> numbers(count);
    if (!encoding_.binary) {
      const std::string line = keyword();
      std::string_view rest = line;
      for (std::uint32_t& number : numbers) {
        rest.remove_prefix(std::min(rest.find_first_not_of(" \t"), rest.size()));
        const auto [end, error] = std::from_chars(rest.data(), rest.data() + rest.size(), number);
        rest.remove_prefix(static_cast<std::size_t>(end - rest.data()));
        const bool whole = error == std::errc() && (rest.empty() || is_white_space(rest.front()));
        if (!whole && !line.empty() && !ended_) refuse(line);
      }
      ended_ = ended_ || line.empty();
      return numbers;
    }
    mark();
    for (std::uint32_t& number : numbers) number = whole_number();
    mark();
    return numbers;
  }

  std::uint64_t count() { return counts(1).front(); }

  /// The number of a part, by which a binary file tells its order of bytes.
  std::uint64_t part_number() {
    if (!encoding_.binary || encoding_.little_endian) return count();
    mark();
    const std::uint32_t number = whole_number();
    mark();
    encoding_.little_endian = number >= part_limit;
    return *encoding_.little_endian ? swapped(number) : number;
  }

  /// Skips `count` numbers of four bytes in one record; in a text file a line for each. Returns which of them are not
  /// written: they pass.
  std::vector<std::uint64_t> skip_values(std::uint64_t count) {
    std::vector<std::uint64_t> unwritten;
    if (encoding_.binary) skip_bytes(count);
    for (std::uint64_t i = 0; !encoding_.binary && i < count && !ended_; ++i) {
      const std::string line = next_line();
      const std::string_view word = trimmed(line);
      if (ended_ || is_number(word)) continue;
      is_unwritten(word) ? unwritten.push_back(i) : refuse(word);
    }
    return unwritten;
  }

  /// Reads `count` numbers of four bytes in one record; in a text file a line for each. Appends those that are not
  /// written to `unwritten`, and returns NaN for them.
  std::vector<float> values(std::uint64_t count, std::vector<std::uint64_t>& unwritten) {
    std::vector<float> numbers;
    if (encoding_.binary) mark();
    for (std::uint64_t i = 0; i < count && !ended_; ++i) {
      const auto number = encoding_.binary ? std::optional(std::bit_cast<float>(whole_number())) : text_value();
      if (!number) unwritten.push_back(i);
      numbers.push_back(number.value_or(std::numeric_limits<float>::quiet_NaN()));
    }
    if (encoding_.binary) mark();
    return numbers;
  }

  /// Reads a list of integers of four bytes in one record; in a text file a line for each.
  std::vector<std::uint64_t> list(std::uint64_t count) {
    if (count > words_.size()) ended_ = true;
    std::vector<std::uint64_t> numbers;
    if (encoding_.binary) mark();
    while (numbers.size() < count && !ended_) numbers.push_back(encoding_.binary ? whole_number() : counts(1).front());
    if (encoding_.binary) mark();
    return numbers;
  }

  /// The same for numbers that must be there.
  void skip_numbers(std::uint64_t count) {
    if (!skip_values(count).empty()) refuse("***");
  }

  /// Skips `count` integers of four bytes in one record; in a text file `lines` lines with as many together.
  void skip_integers(std::uint64_t count, std::uint64_t lines) {
    if (encoding_.binary) return skip_bytes(count);
    std::uint64_t there = 0;
    for (std::uint64_t i = 0; i < lines && !ended_; ++i) {
      const auto of_line = words_.integers_in_line();
      end_unless_line_ended(of_line.value_or(1) > 0);
      if (!of_line) refuse("a word");
      there += of_line.value_or(0);
    }
    if (!ended_ && there != count) refuse(fmt::format("one of {} numbers instead of {}", there, count));
  }

  /// Skips the smallest and largest coordinates.
  void skip_extents() {
    if (encoding_.binary) return skip_bytes(6);
    ended_ = ended_ || !words_.skip_lines(3);
  }

  /// The sum of `count` counts in one record, or in a line for each.
  std::uint64_t sum(std::uint64_t count) {
    std::uint64_t sum = 0;
    mark();
    for (std::uint64_t i = 0; i < count && !ended_; ++i) sum += encoding_.binary ? whole_number() : counts(1).front();
    mark();
    return sum;
  }

 private:
  void end_unless_line_ended(bool holds_something) {
    if (words_.ended_line()) return;
    open_end_ = open_end_ || (!ended_ && holds_something);
    ended_ = true;
  }

  /// A line of text, which must end.
  std::string next_line() {
    std::string line = words_.line();
    end_unless_line_ended(!line.empty());
    return line;
  }

  /// Reads a line with a number; nothing if it is not written.
  std::optional<float> text_value() {
    const std::string line = next_line();
    std::string_view word = trimmed(line);
    if (word.starts_with('+')) word.remove_prefix(1);
    if (const auto number = number_of<float>(word)) return number;
    if (is_number(trimmed(line))) return static_cast<float>(std::strtod(line.c_str(), nullptr));  // out of range
    if (!ended_ && !is_unwritten(word)) refuse(word);
    return std::nullopt;
  }

  /// Skips a record of numbers of four bytes.
  void skip_bytes(std::uint64_t count) {
    mark();
    ended_ = ended_ || count > words_.size() || !words_.skip_bytes(4 * count);
    mark();
  }

  void refuse(std::string_view word) {
    ended_ = true;
    odd_ = std::string(word);
  }

  static std::uint32_t swapped(std::uint32_t number) { return __builtin_bswap32(number); }

  /// Skips the length that stands before and after a record of Fortran.
  void mark() {
    if (encoding_.fortran && !words_.skip_bytes(4)) ended_ = true;
  }

  std::uint32_t whole_number() {
    ended_ = ended_ || words_.size() - std::min(words_.offset(), words_.size()) < 4;
    const auto number = static_cast<std::uint32_t>(words_.number(4));
    return encoding_.little_endian.value_or(false) ? swapped(number) : number;
  }

  FileWords words_;
  EnsightEncoding encoding_;
  bool ended_ = false;
  bool open_end_ = false;
  std::optional<std::string> odd_;
};

/// Points and elements of a part.
struct Part {
  std::size_t index = 0;  // among the parts of the geometry
  std::uint64_t nodes = 0;
  std::map<std::string, std::uint64_t, std::less<>> elements;     // of each type; "block" of a structured part
  std::vector<std::pair<std::string, std::uint64_t>> lists = {};  // of elements, in their order: type and number

  [[nodiscard]] std::uint64_t ghosts() const {
    std::uint64_t count = 0;
    for (const auto& [type, number] : lists) count += type.starts_with("g_") ? number : 0;
    return count;
  }

  /// Elements that are no ghosts.
  [[nodiscard]] std::uint64_t cells() const {
    std::uint64_t count = 0;
    for (const auto& [type, number] : elements) count += type.starts_with("g_") ? 0 : number;
    return count;
  }

  /// The index in the part of an element that is number `element` of its type. VTK leaves out ghosts.
  [[nodiscard]] std::uint64_t index_of(std::string_view type, std::uint64_t element) const {
    std::uint64_t before = 0;
    for (const auto& [of_list, count] : lists) {
      if (of_list == type && element < count) break;
      if (of_list == type) element -= count;
      before += of_list.starts_with("g_") ? 0 : count;
    }
    return before + element;
  }
};
using Layout = std::map<std::uint64_t, Part>;  // by the parts' numbers

/// Nodes of an element of a type; 1 for types whose elements count their nodes; 0 if unknown.
std::uint64_t nodes_of(std::string_view type) {
  constexpr std::array<std::string_view, 14> with_nodes = {"bar2",   "bar3",    "tria3",   "tria6",    "quad4",
                                                           "quad8",  "tetra4",  "tetra10", "pyramid5", "pyramid13",
                                                           "penta6", "penta15", "hexa8",   "hexa20"};
  if (type.starts_with("g_")) type.remove_prefix(2);
  if (is_one_of(type, {"point", "nsided", "nfaced"})) return 1;
  const bool known = std::ranges::find(with_nodes, type) != with_nodes.end();
  return known ? number_of<std::uint64_t>(type.substr(type.find_first_of("123456789"))).value_or(0) : 0;
}

std::string_view first_word(std::string_view line) { return line.substr(0, line.find_first_of(" \t")); }
bool has_word(std::string_view line, std::string_view word) { return line.find(word) != std::string_view::npos; }

tl::unexpected<Error> fail_open_end(const std::string& path) {
  return fail(ErrorCode::invalid_data,
              "{}: no line end follows its last line: the file may be cut off; if it is whole, add a line end", path);
}

/// The base of walks through geometry and variables. A walk stops, without an error, at something unknown.
class EnsightWalk {
 public:
  EnsightWalk(std::string path, std::unique_ptr<ByteSource> file, EnsightEncoding encoding)
      : path_(std::move(path)), file_(std::move(file), encoding) {}

  [[nodiscard]] const EnsightEncoding& encoding() const { return file_.encoding(); }

 protected:
  [[nodiscard]] bool goes_on() const { return !stopped_ && !file_.ended(); }

  /// Fails if the file ended within what was walked through so far.
  [[nodiscard]] Status finish() const {
    if (!file_.ended()) return {};
    if (file_.odd())
      return fail(ErrorCode::invalid_data,
                  "{}: \"{}\" stands for a number within {}, which VTK's reader takes for another: damaged, or not "
                  "written as 1.5e+00",
                  path_, printable(*file_.odd()), where_);
    if (file_.has_open_end()) return fail_open_end(path_);
    return fail(ErrorCode::invalid_data, "{}: the file is cut off, or damaged: it ends within {}", path_, where_);
  }

  /// Fails unless a line ends a step.
  [[nodiscard]] Status check_last_line(std::string_view line) const {
    if (!goes_on() || line.empty() || line == "END TIME STEP") return {};
    return fail(ErrorCode::invalid_data, "{}: an unknown line \"{}\" after {}: damaged", path_, printable(line),
                where_);
  }

  /// The beginning of a line.
  [[nodiscard]] static std::string printable(std::string_view line) {
    std::string text(line.substr(0, text_bytes));
    for (char& c : text) c = c >= ' ' && c <= '~' ? c : '?';
    return text;
  }

  [[nodiscard]] tl::unexpected<Error> fail_mark() const {
    return fail(ErrorCode::invalid_data, "{}: a time step does not begin with \"BEGIN TIME STEP\": damaged", path_);
  }

  [[nodiscard]] Status check_steps(std::size_t found, std::size_t stated) const {
    if (stopped_ || found >= stated) return {};
    return fail(ErrorCode::invalid_data,
                "{}: the file is cut off: it holds {} of the {} time steps that the case states", path_, found, stated);
  }

  std::string path_;
  EnsightReader file_;
  bool stopped_ = false;
  std::string where_ = "its first lines";
};

class GeometryWalk : public EnsightWalk {
 public:
  using EnsightWalk::EnsightWalk;

  /// Finds how the files are written, and no layout.
  Result<std::vector<Layout>> encoding_only() {
    file_.find_encoding();
    return std::vector<Layout>();
  }

  /// Returns the layout at each time step of the file; none if something in it is unknown.
  Result<std::vector<Layout>> walk(const EnsightFile& stated) {
    std::vector<Layout> layouts;
    file_.find_encoding();
    do {
      SPLATVOL_TRY_ASSIGN(layout, walk_step(stated.marked));
      layouts.push_back(std::move(layout));
    } while (goes_on() && !file_.at_end());
    SPLATVOL_TRY(finish());
    SPLATVOL_TRY(check_steps(layouts.size(), stated.steps));
    if (stopped_) layouts.clear();
    return layouts;
  }

 private:
  Result<Layout> walk_step(bool marked) {
    Layout layout;
    where_ = "its first lines";
    std::string line;
    // The step's mark and two lines of description, which may be empty.
    for (int i = 0; i < 5 && !line.starts_with("node id"); ++i) {
      line = bare_case_line(file_.line());
      if (i == 0 && marked && !line.starts_with("BEGIN TIME STEP")) return fail_mark();
    }
    stopped_ = !line.starts_with("node id");
    node_ids_ = has_word(line, "given") || has_word(line, "ignore");
    line = file_.keyword();
    element_ids_ = has_word(line, "given") || has_word(line, "ignore");
    line = file_.keyword();
    if (line.starts_with("extents")) {
      file_.skip_extents();
      line = file_.keyword();
    }
    while (goes_on() && line == "part") {
      const std::uint64_t number = file_.part_number();
      where_ = fmt::format("part {}", number);
      file_.line();  // its description
      const std::size_t index = layout.size();
      if (layout.contains(number) && !file_.ended())
        return fail(ErrorCode::invalid_data, "{}: two parts have the number {}: give each its own", path_, number);
      Part& part = layout[number];
      part.index = index;
      line = walk_part(part);
    }
    SPLATVOL_TRY(check_last_line(line));
    return layout;
  }

  /// Returns the line after the part.
  std::string walk_part(Part& part) {
    std::string line = file_.keyword();
    if (first_word(line) == "block") return walk_block(part, line);
    if (line == "coordinates") {
      part.nodes = file_.count();
      if (node_ids_) (void)file_.skip_values(part.nodes);
      for (int axis = 0; axis < 3; ++axis) file_.skip_numbers(part.nodes);
      line = file_.keyword();
    }
    for (; goes_on() && nodes_of(line) > 0; line = file_.keyword()) walk_elements(part, line);
    return line;
  }

  void walk_elements(Part& part, const std::string& type) {
    where_ += fmt::format(", {}", type);
    const std::uint64_t count = file_.count();
    part.elements[type] += count;
    part.lists.emplace_back(type, count);
    if (element_ids_) (void)file_.skip_values(count);
    if (type.ends_with("nsided")) {
      file_.skip_integers(file_.sum(count), count);
    } else if (type.ends_with("nfaced")) {
      const std::uint64_t faces = file_.sum(count);
      file_.skip_integers(file_.sum(faces), faces);
    } else {
      file_.skip_integers(count * nodes_of(type), count);
    }
  }

  std::string walk_block(Part& part, const std::string& header) {
    where_ += ", block";
    if (has_word(header, "range") || has_word(header, "ghost")) {
      stopped_ = true;
      return {};
    }
    const auto sides = file_.counts(3);
    std::uint64_t cells = 1;
    part.nodes = 1;
    for (const std::uint64_t side : sides) {
      // More than one for each bit of a file cannot be there; the product of such numbers would overflow.
      const bool fits = side < (std::uint64_t{1} << 20);
      stopped_ = stopped_ || !fits;
      part.nodes *= fits ? side : 1;
      cells *= fits ? std::max<std::uint64_t>(side, 2) - 1 : 1;
    }
    part.elements["block"] = cells;
    if (has_word(header, "uniform")) {
      for (int i = 0; i < 2; ++i) file_.skip_numbers(3);
    } else if (has_word(header, "rectilinear")) {
      for (const std::uint64_t side : sides) file_.skip_numbers(side);
    } else {
      for (int axis = 0; axis < 3; ++axis) file_.skip_numbers(part.nodes);
    }
    if (has_word(header, "iblanked")) file_.skip_numbers(part.nodes);
    std::string line = file_.keyword();
    // Lists of ids and ghosts may follow, which VTK does not know.
    stopped_ = stopped_ || !(line.empty() || line == "part" || line == "END TIME STEP");
    return line;
  }

  bool node_ids_ = false;
  bool element_ids_ = false;
};

class VariableWalk : public EnsightWalk {
 public:
  VariableWalk(std::string path, std::unique_ptr<ByteSource> file, EnsightEncoding encoding,
               const EnsightFiles& variable)
      : EnsightWalk(std::move(path), std::move(file), encoding),
        variable_(variable),
        values_{.variable = variable.variable,
                .per_element = variable.per_element,
                .complex_part = variable.complex_part,
                .components = variable.components} {}

  /// What was found of the step that is wanted.
  EnsightValues take_values() { return std::move(values_); }

  /// Reads the values of this step, too.
  void read_values() { reads_values_ = true; }

  /// `layouts`: of each step, or one for all.
  Status walk(const std::vector<Layout>& layouts, const EnsightFile& stated) {
    if (file_.at_end()) return fail(ErrorCode::invalid_data, "{}: the file is cut off: it is empty", path_);
    std::size_t found = 0;
    for (; goes_on() && (found == 0 || !file_.at_end()); ++found) {
      if (found >= layouts.size() && layouts.size() > 1) return {};
      is_wanted_ = found == stated.step;
      SPLATVOL_TRY(walk_step(layouts[std::min(found, layouts.size() - 1)], stated.marked));
    }
    SPLATVOL_TRY(finish());
    return check_steps(found, stated.steps);
  }

 private:
  Status walk_step(const Layout& layout, bool marked) {
    where_ = "its first lines";
    std::string line = file_.keyword();
    if (line == "C Binary" || line == "Fortran Binary") line = file_.keyword();
    const bool mark = line.starts_with("BEGIN TIME STEP");
    if (marked && !mark) return fail_mark();
    if (mark) line = file_.keyword();
    line = file_.keyword();  // after a line of description
    std::set<std::uint64_t> parts;
    while (goes_on() && line == "part") {
      const std::uint64_t number = file_.part_number();
      where_ = fmt::format("part {}", number);
      const auto part = layout.find(number);
      if (part == layout.end() && !file_.ended())
        return fail(ErrorCode::invalid_data,
                    "{}: values of part {}, which the geometry lacks: damaged, or of another mesh", path_, number);
      if (file_.ended()) break;
      if (!parts.insert(number).second)
        return fail(ErrorCode::invalid_data, "{}: values of part {} twice: leave out one", path_, number);
      line = walk_part(part->second);
    }
    SPLATVOL_TRY(check_last_line(line));
    SPLATVOL_TRY(finish());
    if (stopped_ || !parts.empty()) return {};
    return fail(ErrorCode::invalid_data, "{}: the file is cut off: it has values of no part", path_);
  }

  /// Returns the line after the part.
  std::string walk_part(const Part& part) {
    std::string line = file_.keyword();
    if (!variable_.per_element) {
      const std::string_view word = first_word(line);
      if (word != "coordinates" && word != "block") return line;
      note_part(part, part.nodes);
      walk_values(line, part, part.nodes);
      return file_.keyword();
    }
    std::size_t types = 0;
    for (; goes_on(); line = file_.keyword(), ++types) {
      const auto elements = part.elements.find(first_word(line));
      if (elements == part.elements.end()) break;
      where_ += fmt::format(", {}", elements->first);
      note_part(part, part.cells());
      walk_values(line, part, elements->second);
    }
    if (line.empty() && types < part.elements.size()) file_.end();
    return line;
  }

  /// Notes that a part of so many points or cells has values. A geometry of a few bytes may have any number of them,
  /// and a file of values a few partial ones.
  void note_part(const Part& part, std::uint64_t count) {
    constexpr std::uint64_t most_per_byte = 8;
    if (!is_wanted_) return;
    if (count > most_per_byte * file_.size()) return file_.end();
    values_.parts.insert(part.index);
    if (reads_values_)
      values_.of_parts[part.index].resize(count * variable_.components, std::numeric_limits<float>::quiet_NaN());
  }

  void walk_values(std::string_view header, const Part& part, std::uint64_t count) {
    if (reads_values_ && is_wanted_) return read_part(header, part, count);
    if (has_word(header, "undef")) file_.skip_numbers(1);
    if (has_word(header, "partial")) {
      count = file_.count();
      file_.skip_integers(count, count);
      for (std::size_t c = 0; c < variable_.components; ++c) file_.skip_numbers(count);
      return;
    }
    for (std::size_t c = 0; c < variable_.components; ++c)
      for (const std::uint64_t i : file_.skip_values(count))
        if (is_wanted_)
          values_.gaps.push_back({part.index, c, variable_.per_element ? part.index_of(first_word(header), i) : i});
  }

  /// Reads the values of `count` points, or of as many elements of a type.
  void read_part(std::string_view header, const Part& part, std::uint64_t count) {
    const std::string_view type = first_word(header);
    std::vector<float>& values = values_.of_parts[part.index];
    std::vector<std::uint64_t> elements, unwritten;
    const std::vector<float> undefined = has_word(header, "undef") ? file_.values(1, unwritten) : std::vector<float>();
    const bool is_partial = has_word(header, "partial");
    if (is_partial) elements = file_.list(count = file_.count());
    for (std::size_t c = 0; c < variable_.components; ++c) {
      unwritten.clear();
      const std::vector<float> read = file_.values(count, unwritten);
      if (type.starts_with("g_") || (is_partial && elements.size() < read.size())) continue;
      const auto index_of = [&](std::size_t i) {
        const std::uint64_t number = is_partial ? elements[i] - 1 : i;
        return variable_.per_element ? part.index_of(type, number) : number;
      };
      // VTK has the last two components of a symmetric tensor in the other order.
      const std::size_t component = variable_.components == 6 && c >= 4 ? 9 - c : c;
      for (std::size_t i = 0; i < read.size(); ++i)
        if (const std::uint64_t index = index_of(i), at = index * variable_.components + component;
            index < values.size() / variable_.components && (undefined.empty() || read[i] != undefined[0]))
          values[at] = read[i];
      for (const std::uint64_t i : unwritten) values_.gaps.push_back({part.index, component, index_of(i)});
    }
  }

  const EnsightFiles& variable_;
  bool reads_values_ = false;
  bool is_wanted_ = false;  // the current step
  EnsightValues values_;
};

/// Counts how often a text of up to 32 bytes stands in a file.
Result<std::size_t> count_in(ByteSource& file, std::string_view word) {
  constexpr std::uint64_t at_once = 1 << 20;
  std::size_t count = 0;
  for (std::uint64_t offset = 0; offset < file.size(); offset += at_once) {
    SPLATVOL_TRY_ASSIGN(text, read_text(file, offset, at_once + word.size() - 1));
    for (std::size_t at = text.find(word); at < std::min<std::size_t>(text.size(), at_once);
         at = text.find(word, at + 1))
      ++count;
  }
  return count;
}

/// VTK 9.1 gives such blocks of EnSight 6 coordinates by chance.
Status check_blocks_of_6(const std::string& path, ByteSource& file) {
  for (const std::string_view block : {"block rectilinear", "block uniform"}) {
    SPLATVOL_TRY_ASSIGN(count, count_in(file, block));
    if (count > 0)
      return fail(ErrorCode::unsupported,
                  "{}: VTK's reader cannot read a \"{}\" of EnSight 6: write the case as EnSight Gold", path, block);
  }
  return {};
}

/// VTK's reader looks for the mark of a step without an end.
Status check_marks(const std::string& path, ByteSource& file, const EnsightFile& stated) {
  if (!stated.marked) return {};
  SPLATVOL_TRY_ASSIGN(begins, count_in(file, "BEGIN TIME STEP"));
  SPLATVOL_TRY_ASSIGN(ends, count_in(file, "END TIME STEP"));
  const std::size_t found = std::min(begins, ends);
  if (found >= stated.steps) return {};
  return fail(ErrorCode::invalid_data,
              "{}: has {} of the {} time steps that the case states, between \"BEGIN TIME STEP\" and \"END TIME STEP\"",
              path, found, stated.steps);
}

/// The number of the part that begins in a line of EnSight 6, if one does.
std::optional<std::uint64_t> part_in(std::string_view line) {
  constexpr std::string_view part = "part ";
  return line.starts_with(part) ? number_of<std::uint64_t>(trimmed(line.substr(part.size()))) : std::nullopt;
}

/// Checks a text file of which only the first lines are known, `titles` of them: VTK's reader takes zeros for numbers
/// that it cannot read, and in EnSight 6 for the others of their line. It takes the last of several parts of one number
/// there.
Status check_lines(const std::string& path, std::unique_ptr<ByteSource> file, std::uint64_t titles) {
  FileWords words(std::move(file));
  constexpr std::string_view mark = "BEGIN TIME STEP";
  (void)words.skip_lines(words.line().starts_with(mark) ? titles : titles - 1);
  std::set<std::uint64_t> parts;  // of a step
  while (!words.at_end()) {
    const std::string line = words.line();
    if (line.starts_with(mark)) {
      parts.clear();
      (void)words.skip_lines(titles);
    } else if (const auto part = part_in(line)) {
      if (!parts.insert(*part).second)
        return fail(ErrorCode::invalid_data, "{}: two parts have the number {}: leave out one, or give it another",
                    path, *part);
      (void)words.skip_lines(1);  // its description, or the type of its elements
    }
    const bool of_numbers = line.find_first_not_of("0123456789+-.eE*, \t\r") == std::string::npos;
    if (of_numbers && line.find_first_of("*,") != std::string::npos)
      return fail(ErrorCode::invalid_data,
                  "{}: VTK's reader takes zeros for the line \"{}\": stars stand for a number that is too wide, and a "
                  "decimal comma is none; write the case anew",
                  path, line.substr(0, text_bytes));
    if (!words.ended_line() && of_numbers) return fail_open_end(path);
  }
  return {};
}

/// The files of a case at a time.
class CaseFiles {
 public:
  CaseFiles(const std::string& path, const EnsightCase& files, const SourceOptions& options)
      : path_(path), folder_(std::filesystem::path(path).parent_path()), files_(files), options_(options) {
    const auto step = choose_step(files.times(), options.time);
    if (step) time_ = step->time;
    if (files.geometry()) geometry_ = files.file_at(*files.geometry(), time_);
  }

  Result<EnsightFindings> check() {
    if (geometry_) {
      auto file = open_file(folder_ / geometry_->name);
      if (!file) return findings_;  // VTK's reader tells
      SPLATVOL_TRY(check_geometry(folder_ / geometry_->name, std::move(*file)));
    }
    if (!layouts_.empty() && !files_.has_others() &&
        std::ranges::all_of(files_.variables(), [&](const EnsightFiles& variable) {
          return !is_wanted(variable) || can_follow(variable);
        })) {
      findings_.geometry = geometry_;
      findings_.is_binary = encoding_.binary;
    }
    for (const EnsightFiles& variable : files_.variables()) SPLATVOL_TRY(check_variable(variable));
    return std::move(findings_);
  }

 private:
  Status check_geometry(const std::string& path, std::unique_ptr<ByteSource> file) {
    if (!files_.is_gold()) SPLATVOL_TRY(check_blocks_of_6(path, *file));
    if (!files_.is_gold()) SPLATVOL_TRY(check_marks(path, *file, *geometry_));
    GeometryWalk walk(path, std::move(file), {});
    SPLATVOL_TRY_ASSIGN(layouts, files_.is_gold() ? walk.walk(*geometry_) : walk.encoding_only());
    layouts_ = std::move(layouts);
    encoding_ = walk.encoding();
    if (!layouts_.empty()) {
      const Layout& layout = layouts_[std::min(geometry_->step, layouts_.size() - 1)];
      findings_.part_numbers.resize(layout.size());
      for (const auto& [number, part] : layout) {
        if (part.index < layout.size()) findings_.part_numbers[part.index] = number;
        if (const std::uint64_t ghosts = part.ghosts(); ghosts > 0) findings_.ghosts[part.index] = ghosts;
      }
    }
    if (!layouts_.empty() || encoding_.binary) return {};
    SPLATVOL_TRY_ASSIGN(text, open_file(path));
    return check_lines(path, std::move(text), 2);
  }

  [[nodiscard]] bool is_wanted(const EnsightFiles& variable) const {
    return wants_array(options_.selection, variable.variable);
  }

  /// Whether it is known what a variable has at each step of its file. Without the geometry of all steps, a file of
  /// several steps cannot be followed.
  [[nodiscard]] bool can_follow(const EnsightFiles& variable) const {
    if (layouts_.empty()) return false;
    const auto values = files_.file_at(variable, time_);
    const bool moves = geometry_ && files_.geometry()->name.find('*') != std::string::npos;
    if (!values) return false;
    return layouts_.size() > 1 ? values->steps == layouts_.size() : !(moves && values->steps > 1);
  }

  Status check_variable(const EnsightFiles& variable) {
    const auto values = files_.file_at(variable, time_);
    if (!values && is_wanted(variable))
      return fail(
          ErrorCode::invalid_data,
          "{}: the case does not tell which file has {}: its time set, its file set or a number of it is missing",
          path_, variable.variable);
    const std::string path = values ? folder_ / values->name : folder_;
    auto file = open_file(path);
    const bool is_read = findings_.geometry && is_wanted(variable);
    if (is_read && !file) return tl::unexpected(file.error());
    if (!values || !file) return {};
    if (!can_follow(variable)) SPLATVOL_TRY(check_marks(path, **file, *values));
    if (!can_follow(variable)) return encoding_.binary ? Status{} : check_lines(path, std::move(*file), 1);
    VariableWalk walk(path, std::move(*file), encoding_, variable);
    if (is_read) walk.read_values();
    SPLATVOL_TRY(walk.walk(layouts_, *values));
    EnsightValues of_variable = walk.take_values();
    if (files_.begins_after(variable, time_)) of_variable.parts.clear(), of_variable.of_parts.clear();
    findings_.variables.push_back(std::move(of_variable));
    return {};
  }

  const std::string& path_;
  std::filesystem::path folder_;
  const EnsightCase& files_;
  const SourceOptions& options_;
  std::optional<double> time_;
  std::optional<EnsightFile> geometry_;
  std::vector<Layout> layouts_;  // none: what the geometry holds is not known
  EnsightEncoding encoding_;
  EnsightFindings findings_;
};

}  // namespace

Result<EnsightFindings> check_ensight_files(const std::string& path, const EnsightCase& files,
                                            const SourceOptions& options) {
  if (files.wrong_line().empty()) return CaseFiles(path, files, options).check();
  return fail(ErrorCode::invalid_data, "{}: the line \"{}\" has too few or too many words", path,
              files.wrong_line().substr(0, 80));
}

}  // namespace splatvol
