#include "builder/sources/openfoam/foam_lists.h"

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <span>
#include <string>

#include "builder/sources/read_text.h"

namespace splatvol {
namespace {

constexpr std::uint32_t no_label = std::numeric_limits<std::uint32_t>::max();
constexpr std::size_t longest_number = 128;
constexpr std::string_view ends_number = " \n\t\r()]{};/\v\f";

[[noreturn]] void fail_cut(FoamReader& reader) {
  throw ReaderError("{}: the file is cut off: it ends within a list", reader.stream().name());
}

/// The next word of numbers, which ends at white space or a bracket. It is not taken.
std::string_view number_ahead(FoamReader& reader) {
  reader.skip_space();
  const std::string_view ahead = reader.stream().ahead(longest_number);
  if (ahead.empty()) fail_cut(reader);
  return ahead.substr(0, std::min(ahead.find_first_of(ends_number), ahead.size()));
}

std::int64_t read_label(FoamReader& reader) {
  const std::string_view word = number_ahead(reader);
  const auto label = number_of<std::int64_t>(word);
  if (!label) reader.fail("a whole number must stand there, and not \"{}\"", word.substr(0, 40));
  reader.stream().take(word.size());
  return *label;
}

std::uint32_t checked_label(FoamReader& reader, std::int64_t label) {
  if (label < -1 || label >= static_cast<std::int64_t>(no_label))
    reader.fail("the number {} is out of range in a list of labels", label);
  return static_cast<std::uint32_t>(label);
}

/// The beginning of a list.
struct Start {
  std::optional<std::uint64_t> count;  // none: the list ends at its bracket
  char bracket = 0;                    // 0: an empty list without one
};

/// Reads the beginning of a list. `least_bytes`: the fewest of an element.
Start read_start(FoamReader& reader, std::uint64_t least_bytes, std::uint64_t most) {
  reader.skip_space();
  if (reader.stream().peek() == '(') {
    reader.stream().take();
    if (reader.format().binary) reader.fail("a binary list must state its number of elements");
    return {std::nullopt, '('};
  }
  const std::int64_t count = read_label(reader);
  if (count < 0) reader.fail("a list states {} elements", count);
  Start start{static_cast<std::uint64_t>(count)};
  reader.skip_space();
  const int next = reader.stream().peek();
  if (next == '(' || next == '{') {
    start.bracket = static_cast<char>(next);
    reader.stream().take();
  } else if (count > 0) {
    if (next < 0) fail_cut(reader);
    reader.fail("\"(\" must begin a list of {} elements", count);
  }
  if (*start.count > most) reader.fail("a list states {} elements, where {} are possible", count, most);
  if (start.bracket == '(' && *start.count > reader.stream().most_left() / least_bytes)
    throw ReaderError(
        "{}: the file is cut off or damaged: a list states {} elements, which need more bytes than follow",
        reader.stream().name(), count);
  return start;
}

/// How many elements of a list room is made for at once: a packed file may hold far fewer than it states.
std::size_t first_room(FoamReader& reader, const Start& start) {
  constexpr std::uint64_t most = 1 << 20;
  const std::uint64_t count = start.count.value_or(0);
  return static_cast<std::size_t>(reader.stream().is_packed() ? std::min(count, most) : count);
}

template <class T>
T swapped(T value) {
  auto bytes = std::bit_cast<std::array<std::byte, sizeof(T)>>(value);
  std::ranges::reverse(bytes);
  return std::bit_cast<T>(bytes);
}

/// Reads `count` binary numbers of one type, and appends them as another.
template <class From, class To, class Convert>
void read_binary(FoamReader& reader, std::uint64_t count, std::vector<To>& values, const Convert& convert) {
  constexpr std::size_t at_once = 8192;
  std::array<From, at_once> some;
  while (count > 0) {
    const std::size_t n = static_cast<std::size_t>(std::min<std::uint64_t>(count, at_once));
    reader.stream().read(std::as_writable_bytes(std::span(some).first(n)));
    for (std::size_t i = 0; i < n; ++i)
      values.push_back(convert(reader.format().big_endian ? swapped(some[i]) : some[i]));
    count -= n;
  }
}

void read_binary_numbers(FoamReader& reader, std::uint64_t count, std::vector<double>& values) {
  const auto same = [](auto number) { return static_cast<double>(number); };
  reader.format().scalar_bytes == 4 ? read_binary<float>(reader, count, values, same)
                                    : read_binary<double>(reader, count, values, same);
}

void read_binary_labels(FoamReader& reader, std::uint64_t count, std::vector<std::uint32_t>& values) {
  const auto checked = [&](auto label) { return checked_label(reader, label); };
  reader.format().label_bytes == 8 ? read_binary<std::int64_t>(reader, count, values, checked)
                                   : read_binary<std::int32_t>(reader, count, values, checked);
}

/// Appends the numbers of an element in text. Those of one component may be in brackets, too: sphericalTensor.
void read_element(FoamReader& reader, std::size_t components, std::vector<double>& values) {
  reader.skip_space();
  const bool in_brackets = components > 1 || reader.stream().peek() == '(';
  if (in_brackets) reader.expect('(');
  for (std::size_t c = 0; c < components; ++c) values.push_back(read_number(reader));
  if (in_brackets) reader.expect(')');
}

/// Whether a list goes on with another element. `read`: so many are read.
bool goes_on(FoamReader& reader, const Start& start, std::uint64_t read) {
  if (start.count == read) return false;
  reader.skip_space();
  const bool ends = reader.stream().peek() == ')';
  if (ends && start.count) reader.fail("a list ends after {} of its {} elements", read, *start.count);
  return !ends;
}

/// Appends a list of labels. `may_repeat`: "8{0}" is a list.
void append_labels(FoamReader& reader, std::uint64_t most, bool may_repeat, std::vector<std::uint32_t>& labels) {
  const bool binary = reader.format().binary;
  const Start start = read_start(reader, binary ? static_cast<std::uint64_t>(reader.format().label_bytes) : 1, most);
  if (start.bracket == 0) return;
  if (start.bracket == '{') {
    if (!may_repeat) reader.fail("a list of one value cannot be read there");
    labels.insert(labels.end(), static_cast<std::size_t>(*start.count), checked_label(reader, read_label(reader)));
    return reader.expect('}');
  }
  if (binary) {
    read_binary_labels(reader, *start.count, labels);
  } else {
    for (std::uint64_t i = 0; goes_on(reader, start, i); ++i) {
      if (i == most) reader.fail("a list has more than {} elements", most);
      labels.push_back(checked_label(reader, read_label(reader)));
    }
  }
  reader.expect(')');
}

}  // namespace

std::optional<double> foam_number(std::string_view word) {
  if (word.starts_with('+')) word.remove_prefix(1);
  double number = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), number);
  if (error == std::errc::invalid_argument || end != word.data() + word.size()) return std::nullopt;
  // Too large, or too close to 0.
  return error == std::errc() ? number : std::strtod(std::string(word).c_str(), nullptr);
}

double read_number(FoamReader& reader) {
  reader.skip_space();
  const std::string_view ahead = reader.stream().ahead(longest_number);
  double number = 0;
  const auto [end, error] = std::from_chars(ahead.data(), ahead.data() + ahead.size(), number);
  const auto length = static_cast<std::size_t>(end - ahead.data());
  if (error == std::errc() && length < ahead.size() && ends_number.find(ahead[length]) != std::string_view::npos) {
    reader.stream().take(length);
    return number;
  }
  const std::string_view word = number_ahead(reader);
  const auto other = foam_number(word);
  if (!other) reader.fail("a number must stand there, and not \"{}\"", word.substr(0, 40));
  reader.stream().take(word.size());
  return *other;
}

std::vector<double> read_numbers(FoamReader& reader, std::size_t components, std::optional<std::uint64_t> expected) {
  const bool binary = reader.format().binary;
  const std::uint64_t least_bytes =
      binary ? components * static_cast<std::size_t>(reader.format().scalar_bytes) : 2 * components - 1;
  const Start start = read_start(reader, least_bytes, std::numeric_limits<std::int64_t>::max());
  const auto check_count = [&](std::uint64_t count) {
    if (expected && count != *expected) reader.fail("a list has {} values, and not {}", count, *expected);
  };
  if (start.count) check_count(*start.count);
  std::vector<double> values;
  if (start.bracket == '{') {
    if (!expected) reader.fail("a list of one value cannot be read there");
    std::vector<double> element;
    read_element(reader, components, element);
    reader.expect('}');
    values.reserve(static_cast<std::size_t>(*start.count) * components);
    for (std::uint64_t i = 0; i < *start.count; ++i) values.insert(values.end(), element.begin(), element.end());
    return values;
  }
  values.reserve(first_room(reader, start) * components);
  if (start.bracket == 0) return values;
  if (binary) {
    read_binary_numbers(reader, *start.count * components, values);
  } else {
    for (std::uint64_t i = 0; goes_on(reader, start, i); ++i) read_element(reader, components, values);
  }
  reader.expect(')');
  if (!start.count) check_count(values.size() / components);
  return values;
}

std::vector<std::uint32_t> read_labels(FoamReader& reader, std::uint64_t most) {
  std::vector<std::uint32_t> labels;
  append_labels(reader, most, true, labels);
  return labels;
}

LabelLists read_label_lists(FoamReader& reader) {
  LabelLists lists;
  if (reader.class_name() == "faceCompactList") {
    lists.starts.clear();
    append_labels(reader, no_label - 1, false, lists.starts);
    append_labels(reader, no_label - 1, false, lists.values);
    if (lists.starts.empty()) lists.starts = {0};
    if (lists.starts.front() != 0 || !std::ranges::is_sorted(lists.starts) ||
        lists.starts.back() != lists.values.size())
      reader.fail("the two lists of the faces do not fit together");
    return lists;
  }
  // Each list needs "0()", or "0" and the end of a line.
  const Start start = read_start(reader, 2, no_label - 1);
  if (start.bracket == 0) return lists;
  if (start.bracket == '{') reader.fail("a list of one face cannot be read");
  lists.starts.reserve(first_room(reader, start) + 1);
  for (std::uint64_t i = 0; goes_on(reader, start, i); ++i) {
    append_labels(reader, no_label - 1, false, lists.values);
    if (lists.values.size() >= no_label) reader.fail("more than 2^32 - 1 corners of faces");
    lists.starts.push_back(static_cast<std::uint32_t>(lists.values.size()));
  }
  reader.expect(')');
  return lists;
}

}  // namespace splatvol
