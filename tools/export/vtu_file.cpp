#include "tools/export/vtu_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <limits>
#include <utility>

#include "base/names.h"

namespace splatvol {
namespace {

static_assert(std::endian::native == std::endian::little, "numbers are written as they are");

constexpr std::string_view tail = "\n  </AppendedData>\n</VTKFile>\n";

// A character at the front of a text in UTF-8: its number and bytes. Zero bytes: there is none.
struct Character {
  std::uint32_t number = 0;
  std::size_t bytes = 0;
};

Character first_character(std::string_view text) {
  const auto byte = [&](std::size_t i) { return i < text.size() ? static_cast<unsigned char>(text[i]) : 0u; };
  const std::size_t bytes = byte(0) < 0x80 ? 1 : byte(0) < 0xc2 ? 0 : byte(0) < 0xe0 ? 2 : byte(0) < 0xf0 ? 3 : 4;
  if (bytes < 2) return {byte(0), bytes};
  std::uint32_t number = byte(0) & (0xffu >> (bytes + 1));
  for (std::size_t i = 1; i < bytes; ++i) {
    if ((byte(i) & 0xc0) != 0x80) return {};
    number = number << 6 | (byte(i) & 0x3f);
  }
  constexpr std::array<std::uint32_t, 5> least = {0, 0, 0x80, 0x800, 0x10000};  // fewer bytes would do below it
  return number < least[bytes] ? Character{} : Character{number, bytes};
}

// XML 1.0, production 2: no control characters, surrogates, or U+FFFE and U+FFFF.
bool is_xml(std::uint32_t number) {
  return number == '\t' || number == '\n' || (number >= 0x20 && number < 0xd800) ||
         (number >= 0xe000 && number < 0xfffe) || (number >= 0x10000 && number < 0x110000);
}

std::uint64_t count_of(VtuArray::Of of, const VtuCounts& counts) {
  switch (of) {
    case VtuArray::Of::corners:
      return counts.corners;
    case VtuArray::Of::cells:
    case VtuArray::Of::cell_data:
      return counts.cells;
    case VtuArray::Of::points:
    case VtuArray::Of::point_data:
      break;
  }
  return counts.points;
}

std::uint64_t tuple_bytes(const VtuArray& array) { return array.components * array.number_bytes; }

}  // namespace

std::string vtk_array_element(const VtuArray& array, std::uint64_t offset) {
  // VTK's own key for the unit of an array.
  const std::string unit = fmt::format(
      ">\n          <InformationKey name=\"UNITS_LABEL\" location=\"vtkDataArray\">{}</InformationKey>"
      "\n        </DataArray>\n",
      escape_xml(array.unit));
  return fmt::format(
      "        <DataArray type=\"{}\" Name=\"{}\" NumberOfComponents=\"{}\" format=\"appended\" offset=\"{}\"{}",
      array.type, escape_xml(array.name), array.components, offset, array.unit.empty() ? "/>\n" : unit);
}

std::string escape_xml(std::string_view text) {
  std::string escaped;
  for (std::size_t bytes = 0; !text.empty(); text.remove_prefix(bytes)) {
    const Character character = first_character(text);
    bytes = std::max<std::size_t>(character.bytes, 1);
    if (character.bytes == 0 || !is_xml(character.number))
      escaped += '?';
    else if (bytes == 1 && std::string_view("&<>\"\t\n").find(text[0]) != std::string_view::npos)
      escaped += fmt::format("&#{};", character.number);
    else
      escaped += text.substr(0, bytes);
  }
  return escaped;
}

Status check_vtu_names(const std::string& source, std::span<const std::string> names) {
  std::vector<std::string> escaped;
  for (const std::string& name : names) escaped.push_back(escape_xml(name));
  if (const auto duplicate = find_duplicate(std::move(escaped)))
    return fail(ErrorCode::invalid_argument,
                "{}: two attributes are called \"{}\" in the output: take one (--attribute)", source, *duplicate);
  return {};
}

std::size_t VtuFile::add(VtuArray array) {
  arrays_.push_back({std::move(array)});
  return arrays_.size() - 1;
}

std::size_t VtuFile::add_cells() {
  const auto add_whole = [&](VtuArray::Of of, const char* name) {
    return add({.of = of, .name = name, .type = "Int64", .number_bytes = sizeof(std::int64_t)});
  };
  const std::size_t first = add_whole(VtuArray::Of::corners, "connectivity");
  add_whole(VtuArray::Of::cells, "offsets");
  add({.of = VtuArray::Of::cells, .name = "types", .type = "UInt8", .number_bytes = sizeof(std::uint8_t)});
  return first;
}

void VtuFile::reserve_header() {
  constexpr std::uint64_t most = std::numeric_limits<std::uint64_t>::max();
  for (Placed& placed : arrays_) placed.offset = most;
  const VtuCounts counts = std::exchange(counts_, {most, most, most});
  data_ = reserved_ = header().size();
  counts_ = counts;
  arrays_[0].offset = 0;
}

void VtuFile::set_counts(const VtuCounts& counts) {
  counts_ = counts;
  std::uint64_t end = 0;
  for (Placed& placed : arrays_) {
    placed.offset = end;
    placed.bytes = count_of(placed.array.of, counts) * tuple_bytes(placed.array);
    end += sizeof(std::uint64_t) + placed.bytes;
  }
  data_ = std::max<std::uint64_t>(reserved_, header().size());
}

std::uint64_t VtuFile::offset(std::size_t array) const { return data_ + arrays_[array].offset + sizeof(std::uint64_t); }

Status VtuFile::write(AtomicFile& file, std::size_t array, std::uint64_t first,
                      std::span<const std::byte> numbers) const {
  return file.write_at(offset(array) + first * tuple_bytes(arrays_[array].array), numbers);
}

Status VtuFile::write_frame(AtomicFile& file) const {
  const std::string head = header();
  SPLATVOL_TRY(file.write_at(0, std::as_bytes(std::span(head))));
  for (const Placed& placed : arrays_) {
    const std::array<std::uint64_t, 1> length = {placed.bytes};
    SPLATVOL_TRY(file.write_at(data_ + placed.offset, std::as_bytes(std::span(length))));
  }
  return file.write_at(bytes() - tail.size(), std::as_bytes(std::span(tail)));
}

std::uint64_t VtuFile::bytes() const { return data_ + data_bytes() + tail.size(); }

std::uint64_t VtuFile::data_bytes() const {
  const Placed& last = arrays_.back();
  return last.offset + sizeof(std::uint64_t) + last.bytes;
}

// At least `reserved_` bytes: blanks between two elements make up for short numbers.
std::string VtuFile::header() const {
  const auto elements = [&](std::initializer_list<VtuArray::Of> kinds) {
    std::string text;
    for (const Placed& placed : arrays_)
      if (std::ranges::find(kinds, placed.array.of) != kinds.end())
        text += vtk_array_element(placed.array, placed.offset);
    return text;
  };
  std::string of_cells = elements({VtuArray::Of::cell_data});
  if (!of_cells.empty()) of_cells = fmt::format("      <CellData>\n{}      </CellData>\n", of_cells);
  const std::string text = fmt::format(
      "<?xml version=\"1.0\"?>\n{}\n"
      "<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n"
      "  <UnstructuredGrid>\n"
      "    <Piece NumberOfPoints=\"{}\" NumberOfCells=\"{}\">\n"
      "      <Points>\n{}      </Points>\n      <Cells>\n{}      </Cells>\n      <PointData>\n{}      </PointData>\n{}"
      "    </Piece>\n  </UnstructuredGrid>\n",
      vtk_export_mark, counts_.points, counts_.cells, elements({VtuArray::Of::points}),
      elements({VtuArray::Of::corners, VtuArray::Of::cells}), elements({VtuArray::Of::point_data}), of_cells);
  constexpr std::string_view appended = "  <AppendedData encoding=\"raw\">\n   _";
  const std::uint64_t length = text.size() + appended.size();
  return text + std::string(reserved_ > length ? reserved_ - length : 0, ' ') + std::string(appended);
}

}  // namespace splatvol
