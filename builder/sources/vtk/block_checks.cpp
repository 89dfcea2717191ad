#include "builder/sources/vtk/block_checks.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cstdint>
#include <string_view>
#include <utility>

#include "base/file.h"
#include "builder/sources/read_text.h"
#include "builder/sources/vtk/ensight_case.h"
#include "builder/sources/vtk/file_words.h"
#include "builder/sources/vtk/netcdf_checks.h"

namespace splatvol {
namespace {

constexpr std::uint64_t largest_case = 16 << 20;  // a line for each variable, a number for each time step

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
    if (is_one_of(line, {"FORMAT", "GEOMETRY", "VARIABLE", "FILE"})) {
      section_ = line;
      return {};
    }
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

  /// The largest number of steps that a set of steps declares.
  [[nodiscard]] std::size_t most_steps() const { return most_steps_; }

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
    most_steps_ = std::max(most_steps_, count);
    return start_steps(count);
  }

  const std::string& path_;
  std::size_t steps_ = 0;   // of the current set of steps
  std::size_t values_ = 0;  // of these steps so far
  bool counted_ = false;
  bool in_values_ = false;
  std::string_view section_;    // of the current line
  std::size_t most_steps_ = 0;  // of a set
};

Result<std::size_t> check_case(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(text, read_text(path, largest_case));
  std::string_view whole = text;
  if (whole.find("FORMAT") == std::string_view::npos || whole.find("ensight") == std::string_view::npos)
    return fail(ErrorCode::invalid_data, "{}: not an EnSight case (no FORMAT with a type of ensight)", path);
  CaseChecker checker(path);
  while (!whole.empty()) SPLATVOL_TRY(checker.add(bare_case_line(take_line(whole))));
  SPLATVOL_TRY(checker.finish());
  return checker.most_steps();
}

}  // namespace

Status check_steps(const VtkFile& file, std::size_t found) {
  if (file.kind != VtkFile::Kind::ensight) return {};
  SPLATVOL_TRY_ASSIGN(declared, check_case(file.path));
  if (declared <= std::max<std::size_t>(found, 1)) return {};
  return fail(ErrorCode::unsupported,
              "{}: VTK's reader finds {} of its {} time steps; name the time set in the lines of GEOMETRY and VARIABLE "
              "(\"scalar per node: 1 p p.***\")",
              file.path, found, declared);
}

Result<CaseDoubts> check_case_files(const VtkFile& file, std::optional<double> time) {
  if (file.kind != VtkFile::Kind::ensight) return CaseDoubts();
  SPLATVOL_TRY(check_case(file.path));
  SPLATVOL_TRY_ASSIGN(text, read_text(file.path, largest_case));
  SPLATVOL_TRY_ASSIGN(findings, check_ensight_files(file.path, EnsightCase(text), time));
  return CaseDoubts{std::move(findings), !text.empty() && std::isdigit(static_cast<unsigned char>(text.back())) != 0};
}

Status check_blocks(const VtkFile& file) {
  if (file.kind == VtkFile::Kind::ensight || file.kind == VtkFile::Kind::openfoam) return {};
  SPLATVOL_TRY_ASSIGN(start, read_text(file.path, 64));
  if (file.kind == VtkFile::Kind::exodus && !is_hdf5(start) && !is_netcdf(start))
    return fail(ErrorCode::invalid_data, "{}: not an Exodus file (neither NetCDF nor HDF5)", file.path);
  if (file.kind == VtkFile::Kind::cgns && !is_hdf5(start) && start.find("ADF Database") == std::string::npos)
    return fail(ErrorCode::invalid_data, "{}: not a CGNS file (neither HDF5 nor ADF)", file.path);
  return check_file_end(file.path);
}

Result<std::vector<ArrayShape>> ensight_arrays(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(text, read_text(path, largest_case));
  const std::vector<EnsightFiles> variables = EnsightCase(text).variables();
  std::vector<ArrayShape> shapes;
  for (const EnsightFiles& files : variables)
    if (std::ranges::count(variables, files.variable, &EnsightFiles::variable) == 1)
      shapes.push_back({files.variable, static_cast<int>(files.components), files.per_element});
  return shapes;
}

}  // namespace splatvol
