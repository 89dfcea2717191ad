#include "builder/sources/vtk/ensight_checks.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <string_view>
#include <utility>
#include <vector>

#include "base/file.h"
#include "builder/sources/read_text.h"
#include "builder/sources/time_steps.h"
#include "builder/sources/vtk/file_words.h"

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

/// Numbers and lines of one file, text or binary. `ended()` tells that the file ended before what was read.
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
  [[nodiscard]] bool at_end() {
    if (!encoding_.binary) words_.skip_white_space();
    return words_.at_end();
  }

  /// For a file that lacks something.
  void end() { ended_ = true; }

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

  /// `count` numbers of one record, or line. Numbers that are no counts are 0.
  std::vector<std::uint32_t> counts(std::size_t count) {
    std::vector<std::uint32_t> numbers(count);
    if (!encoding_.binary) {
      const std::string line = keyword();
      std::string_view rest = line;
      for (std::uint32_t& number : numbers) {
        rest.remove_prefix(std::min(rest.find_first_not_of(" \t"), rest.size()));
        const auto end = std::from_chars(rest.data(), rest.data() + rest.size(), number).ptr;
        rest.remove_prefix(static_cast<std::size_t>(end - rest.data()));
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

  /// Skips `count` numbers of four bytes in one record; in a text file `lines` lines.
  void skip(std::uint64_t count, std::uint64_t lines) {
    mark();
    ended_ = ended_ || count > words_.size() ||
             !(encoding_.binary ? words_.skip_bytes(4 * count) : words_.skip_lines(lines));
    mark();
  }
  void skip(std::uint64_t count) { skip(count, count); }

  /// The sum of `count` counts in one record, or in a line for each.
  std::uint64_t sum(std::uint64_t count) {
    std::uint64_t sum = 0;
    mark();
    for (std::uint64_t i = 0; i < count && !ended_; ++i) sum += encoding_.binary ? whole_number() : counts(1).front();
    mark();
    return sum;
  }

 private:
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
};

/// Points and elements of a part.
struct Part {
  std::uint64_t nodes = 0;
  std::map<std::string, std::uint64_t, std::less<>> elements;  // of each type; "block" of a structured part
};
using Layout = std::map<std::uint64_t, Part>;  // by the parts' numbers

/// Nodes of an element of a type; 1 for types whose elements count their nodes; 0 if unknown.
std::uint64_t nodes_of(std::string_view type) {
  constexpr std::array<std::pair<std::string_view, std::uint64_t>, 17> types = {{{"point", 1},
                                                                                 {"bar2", 2},
                                                                                 {"bar3", 3},
                                                                                 {"tria3", 3},
                                                                                 {"tria6", 6},
                                                                                 {"quad4", 4},
                                                                                 {"quad8", 8},
                                                                                 {"tetra4", 4},
                                                                                 {"tetra10", 10},
                                                                                 {"pyramid5", 5},
                                                                                 {"pyramid13", 13},
                                                                                 {"penta6", 6},
                                                                                 {"penta15", 15},
                                                                                 {"hexa8", 8},
                                                                                 {"hexa20", 20},
                                                                                 {"nsided", 1},
                                                                                 {"nfaced", 1}}};
  if (type.starts_with("g_")) type.remove_prefix(2);
  const auto* found = std::ranges::find(types, type, &std::pair<std::string_view, std::uint64_t>::first);
  return found == types.end() ? 0 : found->second;
}

std::string_view first_word(std::string_view line) { return line.substr(0, line.find_first_of(" \t")); }
bool has_word(std::string_view line, std::string_view word) { return line.find(word) != std::string_view::npos; }

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
    if (file_.has_open_end())
      return fail(ErrorCode::invalid_data,
                  "{}: no line end follows its last line: the file may be cut off; if it is whole, add a line end",
                  path_);
    return fail(ErrorCode::invalid_data, "{}: the file is cut off, or damaged: it ends within {}", path_, where_);
  }

  /// Fails unless a line ends a step.
  [[nodiscard]] Status check_last_line(std::string_view line) const {
    if (!goes_on() || line.empty() || line == "END TIME STEP") return {};
    std::string text(line.substr(0, text_bytes));
    for (char& c : text) c = c >= ' ' && c <= '~' ? c : '?';
    return fail(ErrorCode::invalid_data, "{}: an unknown line \"{}\" after {}: damaged", path_, text, where_);
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
      file_.skip(6, 3);
      line = file_.keyword();
    }
    while (goes_on() && line == "part") {
      const std::uint64_t number = file_.part_number();
      where_ = fmt::format("part {}", number);
      file_.line();  // its description
      line = walk_part(layout[number]);
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
      if (node_ids_) file_.skip(part.nodes);
      for (int axis = 0; axis < 3; ++axis) file_.skip(part.nodes);
      line = file_.keyword();
    }
    for (; goes_on() && nodes_of(line) > 0; line = file_.keyword()) walk_elements(part, line);
    return line;
  }

  void walk_elements(Part& part, const std::string& type) {
    where_ += fmt::format(", {}", type);
    const std::uint64_t count = file_.count();
    part.elements[type] += count;
    if (element_ids_) file_.skip(count);
    if (type.ends_with("nsided")) {
      file_.skip(file_.sum(count), count);
    } else if (type.ends_with("nfaced")) {
      const std::uint64_t faces = file_.sum(count);
      file_.skip(file_.sum(faces), faces);
    } else {
      file_.skip(count * nodes_of(type), count);
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
      for (int i = 0; i < 2; ++i) file_.skip(3);
    } else if (has_word(header, "rectilinear")) {
      for (const std::uint64_t side : sides) file_.skip(side);
    } else {
      for (int axis = 0; axis < 3; ++axis) file_.skip(part.nodes);
    }
    if (has_word(header, "iblanked")) file_.skip(part.nodes);
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
      : EnsightWalk(std::move(path), std::move(file), encoding), variable_(variable) {}

  /// `layouts`: of each step, or one for all.
  Status walk(const std::vector<Layout>& layouts, const EnsightFile& stated) {
    if (file_.at_end()) return fail(ErrorCode::invalid_data, "{}: the file is cut off: it is empty", path_);
    std::size_t found = 0;
    for (; goes_on() && (found == 0 || !file_.at_end()); ++found) {
      if (found >= layouts.size() && layouts.size() > 1) return {};
      SPLATVOL_TRY(walk_step(layouts[std::min(found, layouts.size() - 1)], stated.marked));
    }
    SPLATVOL_TRY(finish());
    if (!stopped_ && parts_ == 0)
      return fail(ErrorCode::invalid_data, "{}: the file is cut off: it has values of no part", path_);
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
    while (goes_on() && line == "part") {
      const std::uint64_t number = file_.part_number();
      where_ = fmt::format("part {}", number);
      const auto part = layout.find(number);
      if (part == layout.end() && !file_.ended())
        return fail(ErrorCode::invalid_data,
                    "{}: values of part {}, which the geometry lacks: damaged, or of another mesh", path_, number);
      if (file_.ended()) break;
      ++parts_;
      line = walk_part(part->second);
    }
    SPLATVOL_TRY(check_last_line(line));
    return finish();
  }

  /// Returns the line after the part.
  std::string walk_part(const Part& part) {
    std::string line = file_.keyword();
    if (!variable_.per_element) {
      const std::string_view word = first_word(line);
      if (word != "coordinates" && word != "block") return line;
      walk_values(line, part.nodes);
      return file_.keyword();
    }
    std::size_t types = 0;
    for (; goes_on(); line = file_.keyword(), ++types) {
      const auto elements = part.elements.find(first_word(line));
      if (elements == part.elements.end()) break;
      where_ += fmt::format(", {}", elements->first);
      walk_values(line, elements->second);
    }
    if (line.empty() && types < part.elements.size()) file_.end();
    return line;
  }

  void walk_values(std::string_view header, std::uint64_t count) {
    const bool partial = has_word(header, "partial");
    if (has_word(header, "undef")) file_.skip(1);
    if (partial) {
      count = file_.count();
      file_.skip(count);
    }
    for (std::size_t c = 0; c < variable_.components; ++c) file_.skip(count);
  }

  const EnsightFiles& variable_;
  std::size_t parts_ = 0;
};

/// VTK 9.1 gives such blocks of EnSight 6 coordinates by chance.
Status check_blocks_of_6(const std::string& path, ByteSource& file) {
  constexpr std::uint64_t at_once = 1 << 20, overlap = 32;
  for (std::uint64_t offset = 0; offset < file.size(); offset += at_once - overlap) {
    SPLATVOL_TRY_ASSIGN(text, read_text(file, offset, at_once));
    for (const std::string_view block : {"block rectilinear", "block uniform"})
      if (has_word(text, block))
        return fail(ErrorCode::unsupported,
                    "{}: VTK's reader cannot read a \"{}\" of EnSight 6: write the case as EnSight Gold", path, block);
  }
  return {};
}

}  // namespace

Status check_ensight_files(const std::string& path, const EnsightCase& files, std::optional<double> time) {
  if (!files.wrong_line().empty())
    return fail(ErrorCode::invalid_data, "{}: the line \"{}\" has too few or too many words", path,
                files.wrong_line().substr(0, 80));
  if (!files.geometry()) return {};
  const auto step = choose_step(files.times(), time);
  const auto at = step ? std::optional(step->time) : std::nullopt;
  const auto folder = std::filesystem::path(path).parent_path();
  const auto geometry = files.file_at(*files.geometry(), at);
  if (!geometry) return {};
  const std::string geometry_path = folder / geometry->name;
  auto file = open_file(geometry_path);
  if (!file) return {};  // VTK's reader tells
  if (!files.is_gold()) return check_blocks_of_6(geometry_path, **file);
  GeometryWalk walk(geometry_path, std::move(*file), {});
  SPLATVOL_TRY_ASSIGN(layouts, walk.walk(*geometry));
  if (layouts.empty()) return {};

  const bool moves = files.geometry()->name.find('*') != std::string::npos;
  for (const EnsightFiles& variable : files.variables()) {
    const auto values = files.file_at(variable, at);
    // Without the geometry of all steps, a file of several steps cannot be followed.
    const bool known =
        layouts.size() > 1 ? values && values->steps == layouts.size() : values && !(moves && values->steps > 1);
    if (!known) continue;
    const std::string values_path = folder / values->name;
    auto opened = open_file(values_path);
    if (opened)
      SPLATVOL_TRY(VariableWalk(values_path, std::move(*opened), walk.encoding(), variable).walk(layouts, *values));
  }
  return {};
}

}  // namespace splatvol
