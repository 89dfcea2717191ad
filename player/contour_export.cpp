#include "player/contour_export.h"

#include <fmt/format.h>

#include <limits>
#include <nlohmann/json.hpp>
#include <vector>

#include "base/interruption.h"
#include "base/json.h"
#include "base/program.h"

namespace splatvol {
namespace {

// What a line of svexport tells.
struct Told {
  std::optional<double> share = {};
  std::optional<std::uint64_t> triangles = {};
  std::string error = {};
};

Result<Told> read_line(const JsonField& line) {
  Told told;
  if (line.has("share")) SPLATVOL_TRY_SET(told.share, line.member("share").number());
  if (line.has("error")) SPLATVOL_TRY_SET(told.error, line.member("error").text());
  if (line.has("result")) {
    const JsonField result = line.member("result");
    SPLATVOL_TRY_SET(told.triangles,
                     result.member("triangles").whole<std::uint64_t>(0, std::numeric_limits<std::int64_t>::max()));
  }
  return told;
}

std::vector<std::string> command_of(const ContourExportRequest& request, const std::string& svexport) {
  // The shortest text that is this number.
  std::vector<std::string> words = {svexport, "--progress", "--attribute=" + request.attribute,
                                    fmt::format("--contour={}", request.value), "--output=" + request.output};
  if (request.step) words.push_back(fmt::format("--step={}", *request.step));
  if (request.replaces) words.emplace_back("--force");
  words.emplace_back("--");
  words.push_back(request.file);
  return words;
}

}  // namespace

std::string usual_svexport() { return program_beside_this("svexport"); }

Result<std::uint64_t> export_contour_aside(const ContourExportRequest& request, const std::function<void(double)>& tell,
                                           const std::string& svexport) {
  const auto started = RunningProgram::start(command_of(request, svexport));
  if (!started)
    return fail(ErrorCode::io, "{}: svexport writes contours; {}: install it, or name its folder in PATH",
                request.output, started.error().message);
  RunningProgram& program = **started;
  while (!program.is_silent()) {
    SPLATVOL_TRY(check_interruption());
    const auto line = program.read_line(interruption_delay);
    if (!line) continue;
    const auto told = read_json(*line, read_line, 8);
    if (!told) return fail_in("svexport, which is of another version,", told.error());
    if (!told->error.empty()) return fail(ErrorCode::io, "{}", told->error);
    if (told->triangles) {
      static_cast<void>(program.finish());
      return *told->triangles;
    }
    if (told->share) tell(*told->share);
  }
  const std::optional<int> code = program.finish();
  return fail(ErrorCode::io, "{}: svexport ended {} and said nothing: run svexport by hand to see more", request.output,
              code ? fmt::format("with exit code {}", *code) : "by a signal");
}

}  // namespace splatvol
