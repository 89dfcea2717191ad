#include "builder/sources/vtk/messages.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>
#include <vtkLogger.h>
#include <vtkObjectFactory.h>
#include <vtkOutputWindow.h>
#include <vtkSmartPointer.h>

#include <algorithm>
#include <exception>
#include <sstream>
#include <string_view>

#include "base/printable.h"
#include "builder/sources/data_sets.h"

namespace splatvol {
namespace {

/// Receives VTK's messages instead of stderr, and keeps the first error.
class ErrorWindow final : public vtkOutputWindow {
 public:
  static ErrorWindow* New();
  vtkTypeMacro(ErrorWindow, vtkOutputWindow)

      void DisplayText(const char*) override {}
  void DisplayErrorText(const char* text) override {
    // Ranges of arrays that VTK itself writes, and does not read where they are "inf". Nothing here needs them.
    if (std::string_view(text).find("InformationKey") != std::string_view::npos) return;
    // Errors of VTK's pipeline only follow from the reader's own.
    const bool follows = std::string_view(text).find("Algorithm vtk") != std::string_view::npos ||
                         std::string_view(text).find("output port") != std::string_view::npos;
    (follows ? later_error : first_error) = (follows || first_error.empty()) ? text : first_error;
  }
  void DisplayWarningText(const char*) override {}
  void DisplayGenericWarningText(const char*) override {}
  void DisplayDebugText(const char*) override {}

  std::string first_error;
  std::string later_error;
};
vtkStandardNewMacro(ErrorWindow);

/// Whether a word means something to VTK's developers only: a class, the address of an object, a source file.
bool is_internal(std::string_view word) {
  const auto upper = [](char c) { return c >= 'A' && c <= 'Z'; };
  const bool class_name = word.size() > 3 && word.starts_with("vtk") && upper(word[3]) && !is_ghost_array(word);
  return class_name || word.find("(0x") != std::string_view::npos || word.starts_with("0x") ||
         word.find(".cxx") != std::string_view::npos;
}

/// Turns "ERROR: In file, line N\nvtkReader (0x...): Not found.\n\n" into "Not found". `path` begins the message
/// anyway.
std::string one_line(std::string text, const std::string& path) {
  if (text.starts_with("ERROR: In ")) text.erase(0, text.find('\n'));
  if (const std::size_t object = text.find("): "); object != std::string::npos) text.erase(0, object + 3);
  for (std::size_t at = text.find(path); at != std::string::npos; at = text.find(path))
    text.replace(at, path.size(), "");
  std::string line;
  std::istringstream words(text);
  for (std::string word; words >> word;)
    if (!is_internal(word)) line += (line.empty() ? "" : " ") + word;
  line.erase(std::min(line.find(" If you are trying to read"), line.size()));
  if (const std::size_t file = line.find(" for file:"); file != std::string::npos) line.erase(file);
  while (!line.empty() && std::string_view(" .!:").find(line.back()) != std::string_view::npos) line.pop_back();
  return line;
}

/// The parser's own words are "Error parsing XML in stream at line 2, column 3, byte index 90: unclosed token".
std::string xml_failure(const std::string& line) {
  constexpr std::string_view start = "Error parsing XML in stream at ";
  const std::size_t byte = line.find(", byte index"), reason = line.rfind(": ");
  if (!line.starts_with(start) || byte == std::string::npos || reason == std::string::npos) return {};
  return fmt::format("the file is cut off or damaged: its XML breaks at {} ({})",
                     line.substr(start.size(), byte - start.size()), line.substr(reason + 2));
}

std::string describe_failure(const std::string& text, const std::string& path) {
  const std::string line = one_line(text, path);
  if (std::string xml = xml_failure(line); !xml.empty()) return xml;
  constexpr const char* whole = "the file is damaged, or VTK cannot read files of its kind";
  // A failure of VTK's pipeline, with its whole state.
  const bool pipeline = line.starts_with("Algorithm ");
  return line.empty() || pipeline ? whole : fmt::format("{} ({})", whole, line);
}

/// Errors of VTK's pipeline say nothing themselves.
std::string failure_of(const ErrorWindow& window, const std::string& path) {
  if (window.first_error.empty() && window.later_error.empty()) return {};
  return describe_failure(window.first_error, path);
}

}  // namespace

Status run_vtk(const std::string& path, const std::function<void()>& call) {
  vtkLogger::SetStderrVerbosity(vtkLogger::VERBOSITY_OFF);
  const vtkSmartPointer<vtkOutputWindow> usual = vtkOutputWindow::GetInstance();
  const auto window = vtkSmartPointer<ErrorWindow>::New();
  vtkOutputWindow::SetInstance(window);
  std::string failure;
  try {
    call();
    failure = failure_of(*window, path);
  } catch (const std::exception& exception) {
    const auto known = describe_exception(exception);
    failure = known ? *known : describe_failure(exception.what(), path);
  }
  vtkOutputWindow::SetInstance(usual);
  if (!failure.empty()) return fail(ErrorCode::invalid_data, "{}: {}", path, failure);
  return {};
}

}  // namespace splatvol
