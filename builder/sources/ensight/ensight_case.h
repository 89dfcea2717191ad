// The files that an EnSight case names, and their time steps.
#pragma once

#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.h"
#include "builder/sources/array_union.h"

namespace splatvol {

/// A line of GEOMETRY or VARIABLE: a name of files, and how its time steps are spread over them.
struct EnsightFiles {
  int time_set = 0;  // 0: none is named
  int file_set = 0;
  std::string name;            // "*" stands for digits of a number
  std::string variable;        // empty: the geometry
  std::size_t components = 0;  // of a value; 0: the geometry
  bool per_element = false;
  std::optional<std::size_t> complex_part;  // of complex scalars: the file has the real (0) or the imaginary parts (1)
};

/// One file, and the number of time steps that it must hold.
struct EnsightFile {
  std::string name;
  std::size_t steps = 1;
  bool marked = false;   // "BEGIN TIME STEP" begins each step
  std::size_t step = 0;  // of the file, that is wanted
};

class EnsightCase {
 public:
  /// Reads the lines that tell files and times; skips all others. `unknown_line`: as unknown_line(), if one is known.
  explicit EnsightCase(std::string_view text, std::string unknown_line = {});

  [[nodiscard]] bool is_gold() const { return gold_; }
  [[nodiscard]] const std::optional<EnsightFiles>& geometry() const { return geometry_; }
  [[nodiscard]] const std::vector<EnsightFiles>& variables() const { return variables_; }

  /// A line that names files in a wrong way; empty if there is none.
  [[nodiscard]] const std::string& wrong_line() const { return wrong_line_; }

  /// The most steps that a time set declares.
  [[nodiscard]] std::size_t most_steps() const;

  /// Whether the text ends with a digit: a number may be cut off.
  [[nodiscard]] bool has_open_end() const { return open_end_; }

  /// The times of all time sets, without order.
  [[nodiscard]] std::vector<double> times() const;

  /// Whether all steps of `files` come after a time.
  [[nodiscard]] bool begins_after(const EnsightFiles& files, std::optional<double> time) const;

  /// Whether there are sets of files, and a line of GEOMETRY or VARIABLE names none. VTK's reader takes the first then.
  [[nodiscard]] bool mixes_file_sets() const;

  /// Whether it has measured points, or variables of another kind than those here. VTK's reader may know them.
  [[nodiscard]] bool has_others() const { return has_others_; }

  /// Whether the cells have materials.
  [[nodiscard]] bool has_materials() const { return has_materials_; }

  /// A line that VTK's reader does not know, though all that is needed can be read without it; empty if there is none.
  [[nodiscard]] const std::string& unknown_line() const { return unknown_line_; }

  /// The file that holds the last step of `files` not after `time`, else the first step. Nothing if the case does not
  /// tell.
  [[nodiscard]] std::optional<EnsightFile> file_at(const EnsightFiles& files, std::optional<double> time) const;

 private:
  struct TimeSet {
    std::size_t steps = 1;
    std::vector<double> times;
    std::vector<double> numbers;  // of file names
    double start = 0;
    double increment = 1;
  };
  struct FileSet {
    std::vector<double> indices;  // of file names; none: one file
    std::vector<std::size_t> steps;
  };

  void read_line(std::string_view key, std::string_view value);
  void read_time(std::string_view key, std::string_view value);
  void read_file_set(std::string_view key, std::string_view value);
  void read_variable(std::string_view key, std::string_view value);
  [[nodiscard]] const TimeSet* time_set_of(const EnsightFiles& files) const;

  bool gold_ = false;
  std::optional<EnsightFiles> geometry_;
  std::vector<EnsightFiles> variables_;
  std::string wrong_line_, unknown_line_;
  bool open_end_, has_materials_ = false, has_others_ = false;
  std::map<int, TimeSet> time_sets_;
  std::map<int, FileSet> file_sets_;

  // While lines are read:
  std::string section_;
  int set_ = 1;
  std::vector<double>* list_ = nullptr;  // that lines of numbers go on with
};

/// Reads a case file, and the lists of times and of numbers in files that it names. Fails if it is none, and if it has
/// sections or lines of no known kind, entries that are cut off, or names in quotation marks. Safe on untrusted bytes.
[[nodiscard]] Result<EnsightCase> read_ensight_case(const std::string& path);

/// Lists the variables of a case: as VTK's reader has them, a complex scalar as two components, and a complex vector as
/// two vectors. The second function reads a case file, and fails as read_ensight_case.
[[nodiscard]] std::vector<ArrayShape> ensight_arrays(const EnsightCase& files);
[[nodiscard]] Result<std::vector<ArrayShape>> ensight_arrays(const std::string& path);

/// Removes the comment and the white space round a line of a case.
[[nodiscard]] std::string_view bare_case_line(std::string_view line);

/// Removes the first word of such a line, and returns it.
std::string_view take_case_word(std::string_view& line);

}  // namespace splatvol
