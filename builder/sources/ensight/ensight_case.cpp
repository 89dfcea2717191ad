#include "builder/sources/ensight/ensight_case.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <utility>

#include "base/printable.h"
#include "builder/sources/file_words.h"
#include "builder/sources/read_text.h"

namespace splatvol {
namespace {

constexpr std::uint64_t largest_case = 16 << 20;  // a line for each variable, a number for each time step

/// Sections of the format that tell nothing about points and values.
bool is_left_out(std::string_view section) { return is_one_of(section, {"MATERIAL", "SCRIPTS"}); }

std::optional<double> number_in(std::string_view word) {
  if (word.starts_with('+')) word.remove_prefix(1);
  return number_of<double>(word);
}

void append_numbers(std::string_view line, std::vector<double>& numbers) {
  while (!line.empty())
    if (const auto number = number_in(take_case_word(line))) numbers.push_back(*number);
}

/// A count or a number of a set; 0 if there is none, or a wrong one.
int whole_number(std::string_view line) {
  const auto number = number_in(take_case_word(line));
  return number && *number >= 0 && *number < 1e9 ? static_cast<int>(*number) : 0;
}

/// Removes the numbers of the time set and the file set from the beginning of a line.
EnsightFiles take_sets(std::string_view& line) {
  EnsightFiles files;
  for (int* set : {&files.time_set, &files.file_set}) {
    std::string_view rest = line;
    const std::string_view word = take_case_word(rest);
    if (rest.empty() || word.find_first_not_of("0123456789") != std::string_view::npos) break;
    *set = whole_number(word);
    line = rest;
  }
  return files;
}

std::string with_number(const std::string& pattern, double number) {
  const std::size_t first = pattern.find('*'), end = pattern.find_first_not_of('*', first);
  if (first == std::string::npos) return pattern;
  const std::size_t width = std::min(end, pattern.size()) - first;
  return pattern.substr(0, first) + fmt::format("{:0{}}", std::llround(number), width) + pattern.substr(first + width);
}

/// Checks an EnSight case line by line. VTK 9.1 loops for ever on a section that it does not know, and reads time steps
/// that are not there.
class CaseChecker {
 public:
  explicit CaseChecker(const std::string& path) : path_(path) {}

  Status add(std::string_view line) {
    if (line.empty()) return {};
    if (line == "TIME") {
      section_ = line;
      return start_steps(1);  // until the section gives a number
    }
    if (is_one_of(line, {"FORMAT", "GEOMETRY", "VARIABLE", "FILE"}) || is_left_out(line)) {
      section_ = line;
      return {};
    }
    if (is_left_out(section_)) return {};
    if (line.find('"') != std::string_view::npos)
      return fail(ErrorCode::unsupported,
                  "{}: VTK's reader takes no names in quotation marks; remove them: sed 's/\"//g' {} > NEW.case", path_,
                  path_);
    if (line.find_first_not_of("0123456789+-.eE \t") == std::string_view::npos) {
      return in_values_ ? add_times(line) : Status{};
    }
    const std::size_t colon = line.find(':');
    const std::string_view key = line.substr(0, colon);
    const std::string_view value = colon == std::string_view::npos ? "" : bare_case_line(line.substr(colon + 1));
    in_values_ = key == "time values";
    if (in_values_) return add_times(value);
    if (key == "filename numbers") return {};
    if (value.empty() || !belongs(key))
      return fail(ErrorCode::unsupported, "{}: the line \"{}\" is of no kind that VTK's reader of EnSight knows", path_,
                  line.substr(0, 80));
    // A set of files has a number of steps, too.
    return key == "number of steps" && section_ == "TIME" ? read_steps(value) : Status{};
  }

  [[nodiscard]] Status finish() const {
    if (values_ >= steps_) return {};
    return fail(ErrorCode::invalid_data, "{}: {} time steps, but times of {} only", path_, steps_, values_);
  }

 private:
  /// Whether a line of this kind may be in the current section.
  [[nodiscard]] bool belongs(std::string_view key) const {
    if (section_ == "FORMAT") return key == "type";
    if (section_ == "GEOMETRY") return is_one_of(key, {"model", "measured", "match"});
    if (section_ == "VARIABLE") return key.find(" per ") != std::string_view::npos;
    if (section_ == "FILE") return is_one_of(key, {"file set", "filename index", "number of steps"});
    return section_ == "TIME" &&
           is_one_of(key, {"time set", "number of steps", "filename start number", "filename increment"});
  }

  /// VTK's reader takes the beginning of a time that is no number.
  Status add_times(std::string_view text) {
    for (; !text.empty(); ++values_)
      if (const std::string_view word = take_case_word(text); !is_number(word))
        return fail(ErrorCode::invalid_data, "{}: the time value \"{}\" is no number", path_, word.substr(0, 40));
    return {};
  }

  Status start_steps(std::size_t count) {
    SPLATVOL_TRY(finish());
    steps_ = count;
    values_ = 0;
    return {};
  }

  Status read_steps(std::string_view value) {
    std::size_t count = 0;
    if (std::from_chars(value.data(), value.data() + value.size(), count).ec != std::errc{})
      return fail(ErrorCode::invalid_data, "{}: the number of steps is no number", path_);
    // The first number of steps replaces the one step that "TIME" began with.
    if (!counted_) steps_ = 0;
    counted_ = true;
    return start_steps(count);
  }

  const std::string& path_;
  std::size_t steps_ = 0;   // of the current set of steps
  std::size_t values_ = 0;  // of these steps so far
  bool counted_ = false;
  bool in_values_ = false;
  std::string_view section_;  // of the current line
};

}  // namespace

std::string_view bare_case_line(std::string_view line) { return trimmed(line.substr(0, line.find('#'))); }

std::string_view take_case_word(std::string_view& line) {
  const std::string_view word = line.substr(0, line.find_first_of(" \t"));
  line = bare_case_line(line.substr(word.size()));
  return word;
}

EnsightCase::EnsightCase(std::string_view text, std::string unknown_line)
    : unknown_line_(std::move(unknown_line)),
      open_end_(!text.empty() && std::isdigit(static_cast<unsigned char>(text.back())) != 0) {
  while (!text.empty()) {
    const std::string_view line = bare_case_line(take_line(text));
    const std::size_t colon = line.find(':');
    if (line.empty()) continue;
    if (list_ && line.find_first_not_of("0123456789+-.eE \t") == std::string_view::npos) {
      append_numbers(line, *list_);
      continue;
    }
    list_ = nullptr;
    if (colon == std::string_view::npos) {
      section_ = line;
      set_ = 1;
      if (is_left_out(line)) unknown_line_ = line;
      has_materials_ = has_materials_ || line == "MATERIAL";
    } else {
      read_line(bare_case_line(line.substr(0, colon)), bare_case_line(line.substr(colon + 1)));
    }
  }
}

void EnsightCase::read_line(std::string_view key, std::string_view value) {
  if (section_ == "FORMAT" && key == "type") gold_ = value.find("gold") != std::string_view::npos;
  if (section_ == "TIME") read_time(key, value);
  if (section_ == "FILE") read_file_set(key, value);
  if (section_ == "VARIABLE") read_variable(key, value);
  has_others_ = has_others_ || (section_ == "GEOMETRY" && key == "measured");
  if (section_ != "GEOMETRY" || key != "model") return;
  const std::string_view all = value;
  geometry_ = take_sets(value);
  geometry_->name = take_case_word(value);
  if (geometry_->name.empty() || (!value.empty() && !value.starts_with("change_coords_only")))
    wrong_line_ = fmt::format("{}: {}", key, all);
  // With "change_coords_only" later files lack the cells.
  if (!value.empty()) geometry_.reset();
}

void EnsightCase::read_time(std::string_view key, std::string_view value) {
  if (key == "time set") set_ = whole_number(value);
  TimeSet& set = time_sets_[set_];
  if (key == "number of steps") set.steps = static_cast<std::size_t>(whole_number(value));
  if (key == "filename start number") set.start = whole_number(value);
  if (key == "filename increment") set.increment = whole_number(value);
  if (key == "filename numbers") list_ = &set.numbers;
  if (key == "time values") list_ = &set.times;
  if (list_) append_numbers(value, *list_);
}

void EnsightCase::read_file_set(std::string_view key, std::string_view value) {
  if (key == "file set") set_ = whole_number(value);
  FileSet& set = file_sets_[set_];
  if (key == "filename index") set.indices.push_back(whole_number(value));
  if (key == "number of steps") set.steps.push_back(static_cast<std::size_t>(whole_number(value)));
}

void EnsightCase::read_variable(std::string_view key, std::string_view value) {
  struct Kind {
    std::string_view key;
    std::size_t components;
    std::size_t files;
  };
  constexpr std::array<Kind, 7> kinds = {{{"scalar per ", 1, 1},
                                          {"vector per ", 3, 1},
                                          {"tensor per ", 6, 1},
                                          {"tensor symm per ", 6, 1},
                                          {"tensor asym per ", 9, 1},
                                          {"complex scalar per ", 1, 2},
                                          {"complex vector per ", 3, 2}}};
  for (const Kind& kind : kinds) {
    if (!key.starts_with(kind.key)) continue;
    const std::string_view where = key.substr(kind.key.size());
    if (where != "node" && where != "element") break;
    const std::string_view all = value;
    EnsightFiles files = take_sets(value);
    files.variable = as_utf8(take_case_word(value));
    files.components = kind.components;
    files.per_element = where == "element";
    const std::string name = files.variable;
    for (std::size_t i = 0; i < kind.files && !value.empty(); ++i) {
      files.name = take_case_word(value);
      if (kind.files > 1 && kind.components == 1) files.complex_part = i;
      if (kind.files > 1 && kind.components > 1) files.variable = name + (i == 0 ? "_r" : "_i");
      variables_.push_back(files);
    }
    // The frequency of a complex value may follow.
    const bool frequency = kind.files > 1 && value.find(' ') == std::string_view::npos;
    if (files.name.empty() || (!value.empty() && !frequency)) wrong_line_ = fmt::format("{}: {}", key, all);
    return;
  }
  has_others_ = has_others_ || !key.starts_with("constant ");
}

std::size_t EnsightCase::most_steps() const {
  std::size_t most = 0;
  for (const auto& [number, set] : time_sets_) most = std::max(most, set.steps);
  return most;
}

std::vector<double> EnsightCase::times() const {
  std::vector<double> times;
  for (const auto& [number, set] : time_sets_) times.insert(times.end(), set.times.begin(), set.times.end());
  return times;
}

bool EnsightCase::mixes_file_sets() const {
  const auto has_none = [](const EnsightFiles& files) { return files.file_set == 0; };
  return !file_sets_.empty() && ((geometry_ && has_none(*geometry_)) || std::ranges::any_of(variables_, has_none));
}

bool EnsightCase::begins_after(const EnsightFiles& files, std::optional<double> time) const {
  const TimeSet* set = time_set_of(files);
  return time && set && !set->times.empty() && std::ranges::min(set->times) > *time;
}

const EnsightCase::TimeSet* EnsightCase::time_set_of(const EnsightFiles& files) const {
  const auto found = files.time_set == 0 ? time_sets_.begin() : time_sets_.find(files.time_set);
  return found == time_sets_.end() ? nullptr : &found->second;
}

std::optional<EnsightFile> EnsightCase::file_at(const EnsightFiles& files, std::optional<double> time) const {
  const bool numbered = files.name.find('*') != std::string::npos;
  const TimeSet* times = time_set_of(files);
  std::size_t step = 0;
  for (std::size_t i = 0; times && time && i < times->times.size(); ++i)
    if (times->times[i] <= *time) step = i;
  if (files.file_set == 0) {
    if (!numbered) return EnsightFile{files.name};
    if (!times || (!times->numbers.empty() && step >= times->numbers.size())) return std::nullopt;
    const double number =
        times->numbers.empty() ? times->start + times->increment * static_cast<double>(step) : times->numbers[step];
    return EnsightFile{with_number(files.name, number)};
  }

  const auto set = file_sets_.find(files.file_set);
  if (set == file_sets_.end() || set->second.steps.empty()) return std::nullopt;
  const FileSet& several = set->second;
  std::size_t file = 0;
  while (file < several.steps.size() && step >= several.steps[file]) step -= several.steps[file++];
  if (file == several.steps.size() || (numbered && file >= several.indices.size())) return std::nullopt;
  return EnsightFile{numbered ? with_number(files.name, several.indices[file]) : files.name, several.steps[file], true,
                     step};
}

namespace {

/// Lines that name a file of numbers, and those with the numbers themselves.
constexpr std::array<std::array<std::string_view, 2>, 2> lists_in_files = {
    {{"time values file:", "time values:"}, {"filename numbers file:", "filename numbers:"}}};

/// Puts the numbers of files in the place of the lines that name them.
Status insert_lists(const std::string& path, std::string& text, std::string& first_line) {
  std::string whole;
  for (std::string_view rest = text; !rest.empty();) {
    const std::string_view line = take_line(rest), bare = bare_case_line(line);
    const auto list =
        std::ranges::find_if(lists_in_files, [&](const auto& names) { return bare.starts_with(names[0]); });
    if (list == lists_in_files.end()) {
      whole += line;
      whole += '\n';
      continue;
    }
    if (first_line.empty()) first_line = bare;
    const std::string name(bare_case_line(bare.substr((*list)[0].size())));
    SPLATVOL_TRY_ASSIGN(numbers, read_text(std::filesystem::path(path).parent_path() / name, largest_case));
    whole += fmt::format("{}\n{}\n", (*list)[1], numbers);
  }
  if (!first_line.empty()) text = std::move(whole);
  return {};
}

}  // namespace

Result<EnsightCase> read_ensight_case(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(text, read_text(path, largest_case));
  std::string unknown_line;
  SPLATVOL_TRY(insert_lists(path, text, unknown_line));
  std::string_view whole = text;
  if (whole.find("FORMAT") == std::string_view::npos || whole.find("ensight") == std::string_view::npos)
    return fail(ErrorCode::invalid_data, "{}: not an EnSight case (no FORMAT with a type of ensight)", path);
  CaseChecker checker(path);
  while (!whole.empty()) SPLATVOL_TRY(checker.add(bare_case_line(take_line(whole))));
  SPLATVOL_TRY(checker.finish());
  return EnsightCase(text, unknown_line);
}

std::vector<ArrayShape> ensight_arrays(const EnsightCase& files) {
  std::vector<ArrayShape> shapes;
  for (const EnsightFiles& variable : files.variables())
    if (variable.complex_part != 1)
      shapes.push_back(
          {variable.variable, variable.complex_part ? 2 : static_cast<int>(variable.components), variable.per_element});
  return shapes;
}

Result<std::vector<ArrayShape>> ensight_arrays(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(files, read_ensight_case(path));
  return ensight_arrays(files);
}

}  // namespace splatvol
