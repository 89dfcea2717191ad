#include "builder/sources/vtk/messages.h"

#include <fcntl.h>
#include <unistd.h>
#include <vtkLogger.h>
#include <vtkObjectFactory.h>
#include <vtkOutputWindow.h>
#include <vtkSmartPointer.h>

#include <cstdio>
#include <exception>
#include <regex>
#include <string_view>

namespace splatvol {
namespace {

/// Receives VTK's messages instead of stderr, and keeps the first error.
class ErrorWindow final : public vtkOutputWindow {
 public:
  static ErrorWindow* New();
  vtkTypeMacro(ErrorWindow, vtkOutputWindow)

      void DisplayText(const char*) override {}
  void DisplayErrorText(const char* text) override {
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

/// Turns "ERROR: In file, line N\nvtkReader (0x...): Not found\n\n" into "Not found".
std::string one_line(std::string text) {
  if (const std::size_t object = text.find("): "); object != std::string::npos) text.erase(0, object + 3);
  std::string line;
  for (const char c : text) {
    const bool space = c == '\n' || c == '\t' || c == '\r' || c == ' ';
    if (!space) line += c;
    if (space && !line.empty() && line.back() != ' ') line += ' ';
  }
  while (!line.empty() && (line.back() == ' ' || line.back() == '.')) line.pop_back();
  return line;
}

/// Replaces the names of VTK's classes, and the addresses behind them, by plain words.
std::string without_internals(const std::string& line) {
  static const std::regex object("vtk[A-Z][A-Za-z0-9]*(::[A-Za-z]+)?( ?\\(0x[0-9a-f]+\\))?:?");
  return std::regex_replace(line.substr(0, line.find(" If you are trying to read")), object, "the reader");
}

std::string failure_of(const ErrorWindow& window) {
  std::string line = without_internals(one_line(window.first_error));
  if (!line.empty() || window.later_error.empty()) return line;
  return "VTK's reader gives up on it: damaged, or not of the format that its name says";
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
    failure = failure_of(*window);
  } catch (const ReaderError& error) {
    failure = error.what();
  } catch (const std::exception& exception) {
    failure = fmt::format("VTK's reader failed: {}", exception.what());
  }
  vtkOutputWindow::SetInstance(usual);
  if (!failure.empty()) return fail(ErrorCode::invalid_data, "{}: {}", path, failure);
  return {};
}

QuietStderr::QuietStderr() : saved_(-1) {
  std::fflush(stderr);
  const int nothing = ::open("/dev/null", O_WRONLY | O_CLOEXEC);
  if (nothing < 0) return;
  saved_ = ::fcntl(STDERR_FILENO, F_DUPFD_CLOEXEC, 3);
  if (saved_ >= 0) ::dup2(nothing, STDERR_FILENO);
  ::close(nothing);
}

QuietStderr::~QuietStderr() {
  if (saved_ < 0) return;
  std::fflush(stderr);
  ::dup2(saved_, STDERR_FILENO);
  ::close(saved_);
}

}  // namespace splatvol
