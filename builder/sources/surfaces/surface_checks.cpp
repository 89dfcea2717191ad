#include "builder/sources/surfaces/surface_checks.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/file.h"
#include "builder/sources/file_words.h"
#include "builder/sources/read_text.h"

namespace splatvol {
namespace {

constexpr const char* cut_or_comma = "damaged, cut off, or with decimal commas";

using Words = std::vector<std::string_view>;

/// The words of a line, which must outlive them.
Words words_of(std::string_view line) {
  Words words;
  for (std::size_t at = 0; at < line.size();) {
    std::size_t end = at;
    while (end < line.size() && !is_white_space(line[end])) ++end;
    if (end > at) words.push_back(line.substr(at, end - at));
    at = end + 1;
  }
  return words;
}

Status check_stl_text(std::unique_ptr<ByteSource> file) {
  const std::string path = file->name();
  FileWords words(std::move(file));
  bool ended = false;
  for (std::string word = words.next(); !word.empty(); word = words.next()) {
    ended = word == "endsolid";
    if (word == "solid" || ended) words.line();  // its name
    if (word == "vertex" && words.skip_numbers(3) < 3)
      return fail(ErrorCode::invalid_data, "{}: a vertex is not three numbers: {}", path, cut_or_comma);
  }
  if (ended) return {};
  return fail(ErrorCode::invalid_data, "{}: the file is cut off: it does not end with \"endsolid\"", path);
}

struct PlyProperty {
  std::uint64_t bytes = 0;        // of a number
  std::uint64_t count_bytes = 0;  // of the number of a list; 0: no list
};

struct PlyElement {
  std::string name;
  std::uint64_t count = 0;
  std::vector<PlyProperty> properties;
};

class PlyFile {
 public:
  explicit PlyFile(std::unique_ptr<ByteSource> file) : path_(file->name()), words_(std::move(file)) {}

  Result<LastLine> check() {
    SPLATVOL_TRY(read_header());
    if (elements_.size() < 2 || elements_[0].name != "vertex" || elements_[1].name != "face")
      return fail(ErrorCode::unsupported,
                  "{}: its vertices must come first, then its faces, then all else: write it "
                  "so by another program",
                  path_);
    for (const PlyElement& element : elements_) SPLATVOL_TRY(skip(element));
    return last_line_;
  }

 private:
  Status skip(const PlyElement& element) {
    if (element.properties.empty()) return {};
    most_in_list_ = 0;
    for (std::uint64_t i = 0; i < element.count; ++i) {
      const bool skipped = is_text_ ? skip_line(element) : skip_bytes(element);
      if (line_is_too_long_) return fail_long_line();
      if (element.name == "face" && most_in_list_ > most_corners)
        return fail(ErrorCode::unsupported, "{}: a face has more than {} corners: split it into triangles", path_,
                    most_corners);
      if (!skipped)
        return fail(ErrorCode::invalid_data, "{}: it does not hold the numbers that its header states: {}", path_,
                    cut_or_comma);
    }
    return {};
  }

  Status read_header() {
    if (words_of(words_.line()) != Words{"ply"})
      return fail(ErrorCode::invalid_data, "{}: not a PLY file: its first line is not \"ply\"", path_);
    while (words_.ended_line()) {
      const std::string text = words_.line();
      if (text.size() > longest_line) return fail_long_line();
      const Words line = words_of(text);
      if (line.empty()) continue;
      if (line[0] == "end_header" && words_.ended_line()) return {};
      if (line[0] == "format" && line.size() > 1) {
        is_text_ = line[1] == "ascii";
        big_endian_ = line[1] == "binary_big_endian";
      }
      const bool known = line[0] == "element" ? add_element(line) : line[0] != "property" || add_property(line);
      if (!known) return fail(ErrorCode::invalid_data, "{}: the line \"{}\" of its header is damaged", path_, line[0]);
    }
    return fail(ErrorCode::invalid_data, "{}: the file is cut off within its header", path_);
  }

  bool add_element(const Words& line) {
    const auto count = line.size() == 3 ? number_of<std::uint64_t>(line[2]) : std::nullopt;
    if (count) elements_.push_back({std::string(line[1]), *count, {}});
    return count.has_value();
  }

  bool add_property(const Words& line) {
    const bool is_list = line.size() == 5 && line[1] == "list";
    if (elements_.empty() || (!is_list && line.size() != 3)) return false;
    const PlyProperty property{bytes_of(line[is_list ? 3 : 1]), is_list ? bytes_of(line[2]) : 0};
    elements_.back().properties.push_back(property);
    return property.bytes > 0 && (!is_list || property.count_bytes > 0);
  }

  static std::uint64_t bytes_of(std::string_view type) {
    if (is_one_of(type, {"char", "uchar", "int8", "uint8"})) return 1;
    if (is_one_of(type, {"short", "ushort", "int16", "uint16"})) return 2;
    if (is_one_of(type, {"int", "uint", "int32", "uint32", "float", "float32"})) return 4;
    return is_one_of(type, {"double", "float64"}) ? 8 : 0;
  }

  /// Skips the line of an element. Words behind its numbers do not count.
  bool skip_line(const PlyElement& element) {
    const std::string text = words_.line();
    line_is_too_long_ = text.size() > longest_line;
    const Words line = words_of(text);
    const auto taken = words_taken(line, element);
    const bool ends_with_number = taken == line.size() && !text.empty() && !is_white_space(text.back());
    last_line_ = words_.ended_line() ? LastLine::ended : ends_with_number ? LastLine::open_number : LastLine::open;
    return taken.has_value();
  }

  /// How many words of its line an element takes; nothing if a number lacks.
  std::optional<std::size_t> words_taken(const Words& line, const PlyElement& element) {
    std::size_t next = 0;
    for (const PlyProperty& property : element.properties) {
      std::uint64_t count = 1;
      if (property.count_bytes > 0) {
        const auto stated = next < line.size() ? number_of<std::uint64_t>(line[next++]) : std::nullopt;
        if (!stated) return std::nullopt;
        count = *stated;
        most_in_list_ = std::max(most_in_list_, count);
      }
      if (count > line.size() - next || !std::ranges::all_of(std::span(line).subspan(next, count), is_number))
        return std::nullopt;
      next += count;
    }
    return next;
  }

  bool skip_bytes(const PlyElement& element) {
    return std::ranges::all_of(element.properties, [&](const PlyProperty& property) { return skip_bytes(property); });
  }

  bool skip_bytes(const PlyProperty& property) {
    if (property.count_bytes == 0) return words_.skip_bytes(property.bytes);
    const std::string bytes = words_.bytes(property.count_bytes);
    if (bytes.size() < property.count_bytes) return false;
    const std::uint64_t count = number_in(bytes, big_endian_);
    constexpr std::uint64_t most = std::uint64_t{1} << 32;
    most_in_list_ = std::max(most_in_list_, count);
    return count < most && words_.skip_bytes(count * property.bytes);
  }

  [[nodiscard]] tl::unexpected<Error> fail_long_line() const {
    return fail(ErrorCode::unsupported, "{}: a line is longer than {} bytes: write the file again, binary", path_,
                longest_line);
  }

  // What VTK's reader takes. It loses what is longer, and writes beyond its arrays.
  static constexpr std::size_t longest_line = 4000;
  static constexpr std::uint64_t most_corners = 255;

  std::string path_;
  FileWords words_;
  bool is_text_ = false;
  bool big_endian_ = false;
  LastLine last_line_ = LastLine::ended;
  bool line_is_too_long_ = false;
  std::uint64_t most_in_list_ = 0;
  std::vector<PlyElement> elements_;
};

class ObjFile {
 public:
  explicit ObjFile(std::unique_ptr<ByteSource> file) : path_(file->name()), words_(std::move(file)) {}

  Result<LastLine> check() {
    auto last_line = LastLine::ended;
    while (!words_.at_end()) {
      const std::string text = next_line();
      const Words line = words_of(text);
      const bool is_face = !line.empty() && line[0] == "f";
      const bool has_numbers = is_face || (!line.empty() && (line[0] == "v" || line[0] == "vn" || line[0] == "vt"));
      if (is_face ? !is_polygon(line) : has_numbers && !has_coordinates(line))
        return fail(ErrorCode::invalid_data, "{}: line {}: too few numbers after \"{}\", or words that are none: {}",
                    path_, line_, line[0], cut_or_comma);
      last_line = words_.ended_line() ? LastLine::ended : has_numbers ? LastLine::open_number : LastLine::open;
    }
    if (largest_corner_ > vertices_)
      return fail(ErrorCode::invalid_data, "{}: a face names vertex {} of {}: damaged or cut off", path_,
                  largest_corner_, vertices_);
    return last_line;
  }

 private:
  /// A line without its comment, with those that go on with it.
  std::string next_line() {
    std::string whole;
    for (;;) {
      std::string line = words_.line();
      ++line_;
      line.resize(std::min(line.find('#'), line.size()));
      while (line.ends_with('\r') || line.ends_with(' ')) line.pop_back();
      if (!line.ends_with('\\') || words_.at_end()) return whole + line;
      line.back() = ' ';
      whole += line;
    }
  }

  bool has_coordinates(const Words& line) {
    vertices_ += line[0] == "v" ? 1 : 0;
    const std::size_t needed = line[0] == "vt" ? 1 : 3;
    return line.size() > needed && std::ranges::all_of(std::span(line).subspan(1), is_number);
  }

  /// Notes the corners of a face: vertices by their numbers from 1, or from -1 back.
  bool is_polygon(const Words& line) {
    for (std::size_t i = 1; i < line.size(); ++i) {
      const std::size_t slash = std::min(line[i].find('/'), line[i].size());
      const auto corner = number_of<std::int64_t>(line[i].substr(0, slash));
      const bool is_rest = line[i].find_first_not_of("0123456789-/", slash) == std::string::npos;
      if (!corner || *corner == 0 || !is_rest) return false;
      if (*corner < 0 && (*corner < -most_vertices || static_cast<std::uint64_t>(-*corner) > vertices_)) return false;
      if (*corner > 0) largest_corner_ = std::max(largest_corner_, static_cast<std::uint64_t>(*corner));
    }
    return line.size() > 3;
  }

  static constexpr std::int64_t most_vertices = std::int64_t{1} << 62;

  std::string path_;
  FileWords words_;
  std::uint64_t line_ = 0;
  std::uint64_t vertices_ = 0;
  std::uint64_t largest_corner_ = 0;
};

}  // namespace

Status check_stl(const std::string& path) {
  constexpr std::uint64_t header_bytes = 80, triangle_bytes = 50;
  SPLATVOL_TRY_ASSIGN(file, open_file(path));
  SPLATVOL_TRY_ASSIGN(begin, read_text(*file, 0, 256));
  const auto is_ascii = [](char c) { return static_cast<unsigned char>(c) < 128; };
  if (begin.starts_with("solid") && std::ranges::all_of(begin, is_ascii)) return check_stl_text(std::move(file));
  constexpr std::uint64_t first = header_bytes + sizeof(std::uint32_t);
  const std::uint64_t count =
      begin.size() < first ? 0 : number_in(std::string_view(begin).substr(header_bytes, first - header_bytes), false);
  if (file->size() >= first + count * triangle_bytes) return {};
  return fail(ErrorCode::invalid_data, "{}: the file is cut off, or no surface: it states {} triangles", path, count);
}

Result<LastLine> check_ply(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(file, open_file(path));
  return PlyFile(std::move(file)).check();
}

Result<LastLine> check_obj(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(file, open_file(path));
  return ObjFile(std::move(file)).check();
}

}  // namespace splatvol
