#include "sampler/csv_table.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>

#include "base/names.h"

namespace splatvol {
namespace {

constexpr std::size_t text_bytes = std::size_t{1} << 16;  // written at once

std::string field_of(const std::string& name) {
  if (name.find_first_of(",\"\r\n") == std::string::npos) return name;
  std::string quoted = "\"";
  for (const char c : name) quoted += c == '"' ? std::string("\"\"") : std::string(1, c);
  return quoted + '"';
}

Status append(AtomicFile& file, const std::string& text) { return file.append(std::as_bytes(std::span(text))); }

}  // namespace

Status write_csv_header(AtomicFile& file, const std::vector<std::string>& usual,
                        std::span<const std::string> attributes, std::map<std::string, std::string>& renamed) {
  std::string header;
  for (const std::string& of_us : usual) {
    const std::string name = free_name(
        of_us, [&](const std::string& taken) { return std::ranges::find(attributes, taken) != attributes.end(); });
    if (name != of_us) renamed.emplace(of_us, name);
    header += field_of(name) + ',';
  }
  for (const std::string& name : attributes) header += field_of(name) + ',';
  header.back() = '\n';
  return append(file, header);
}

Status write_csv_rows(AtomicFile& file, std::size_t rows,
                      const std::function<void(std::size_t, std::vector<double>&)>& numbers_of) {
  std::string text;
  std::vector<double> numbers;
  for (std::size_t row = 0; row < rows; ++row) {
    numbers_of(row, numbers);
    for (const double number : numbers)
      fmt::format_to(std::back_inserter(text), "{},", std::isnan(number) ? std::abs(number) : number);
    text.back() = '\n';
    if (text.size() <= text_bytes) continue;
    SPLATVOL_TRY(append(file, text));
    text.clear();
  }
  return append(file, text);
}

}  // namespace splatvol
