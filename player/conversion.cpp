#include "player/conversion.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <chrono>
#include <nlohmann/json.hpp>
#include <utility>

#include "base/descriptor.h"
#include "base/file.h"
#include "base/input_formats.h"
#include "base/interruption.h"
#include "base/json.h"
#include "base/program.h"

namespace splatvol {
namespace {

// Keeps a converted file where it is: by a shared lock on it. A temporary file is kept by svbuild, which runs on.
class Lease {
 public:
  Lease(int descriptor, std::unique_ptr<RunningProgram> keeper) : descriptor_(descriptor), keeper_(std::move(keeper)) {}
  ~Lease() { ::close(descriptor_); }
  Lease(const Lease&) = delete;
  Lease& operator=(const Lease&) = delete;

 private:
  int descriptor_;
  std::unique_ptr<RunningProgram> keeper_;
};

// A source by another name.
class NamedSource final : public ByteSource {
 public:
  NamedSource(std::unique_ptr<ByteSource> source, std::string name)
      : source_(std::move(source)), name_(std::move(name)) {}
  [[nodiscard]] std::uint64_t size() const override { return source_->size(); }
  [[nodiscard]] Status read(std::uint64_t offset, std::span<std::byte> out) override {
    return source_->read(offset, out);
  }
  [[nodiscard]] std::uint64_t cheap_gap() const override { return source_->cheap_gap(); }
  [[nodiscard]] const std::string& name() const override { return name_; }
  [[nodiscard]] Result<bool> read_parts(std::span<const Part> parts) override { return source_->read_parts(parts); }
  [[nodiscard]] bool may_read_parts() const override { return source_->may_read_parts(); }

 private:
  std::unique_ptr<ByteSource> source_;
  std::string name_;
};

// What a line of svbuild tells.
struct Told {
  std::optional<ConversionProgress> progress = {};
  bool has_preview = false;
  std::optional<ConvertedFile> result = {};
  std::string error = {};
};

Result<ConversionProgress> read_progress(const JsonField& line) {
  ConversionProgress progress;
  SPLATVOL_TRY_SET(progress.stage, line.member("stage").text());
  SPLATVOL_TRY_SET(progress.share, line.member("share").number());
  if (const JsonField seconds = line.member("seconds_left"); seconds.exists() && !seconds.is_null())
    SPLATVOL_TRY_SET(progress.seconds_left, seconds.number());
  return progress;
}

Result<ConvertedFile> read_result(const JsonField& result) {
  ConvertedFile file;
  SPLATVOL_TRY_SET(file.path, result.member("file").text());
  SPLATVOL_TRY_SET(file.was_built, result.member("built").truth());
  SPLATVOL_TRY_SET(file.is_temporary, result.member("temporary").truth());
  if (result.has("notes")) {
    const JsonField notes = result.member("notes");
    SPLATVOL_TRY_SET(file.notes, notes.each([](const JsonField& note) { return note.text(); }));
  }
  return file;
}

Result<Told> read_line(const JsonField& line) {
  Told told;
  told.has_preview = line.has("preview");
  if (line.has("stage")) SPLATVOL_TRY_SET(told.progress, read_progress(line));
  if (line.has("error")) SPLATVOL_TRY_SET(told.error, line.member("error").text());
  if (line.has("result")) {
    const JsonField result = line.member("result");
    SPLATVOL_TRY_SET(told.result, read_result(result));
  }
  return told;
}

// The file is locked before svbuild lets go of it.
Result<ConvertedFile> with_lease(ConvertedFile file, std::unique_ptr<RunningProgram> svbuild) {
  const int descriptor = uninterrupted([&] { return ::open(file.path.c_str(), O_RDONLY | O_CLOEXEC); });
  if (descriptor < 0) return fail_errno(file.path, "cannot open");
  // A file system without locks has none that could be broken, either.
  static_cast<void>(uninterrupted([&] { return ::flock(descriptor, LOCK_SH | LOCK_NB); }));
  if (!file.is_temporary) {
    static_cast<void>(svbuild->finish());
    svbuild.reset();
  }
  file.lease = std::make_shared<Lease>(descriptor, std::move(svbuild));
  return file;
}

tl::unexpected<Error> fail_early_end(const std::string& input, RunningProgram& svbuild) {
  const std::optional<int> code = svbuild.finish();
  return fail(ErrorCode::io, "{}: svbuild ended {} and said nothing: run svbuild by hand to see more", input,
              code ? fmt::format("with exit code {}", *code) : "by a signal");
}

std::vector<std::string> command_of(const ConversionRequest& request, const std::string& svbuild) {
  std::vector<std::string> words = {svbuild, "--cached", "--progress"};
  if (request.all_steps) words.insert(words.end(), {"--times", "all"});
  if (!request.preview.empty()) words.insert(words.end(), {"--preview", request.preview});
  words.emplace_back("--");
  words.insert(words.end(), request.inputs.begin(), request.inputs.end());
  return words;
}

tl::unexpected<Error> fail_no_svbuild(const std::string& input, const std::string& reason) {
  return fail(ErrorCode::io, "{}: svbuild converts meshes; {}: install it, or name its folder in PATH", input, reason);
}

}  // namespace

bool needs_conversion(const std::vector<std::string>& files) { return files.size() > 1 || is_convertible(files.at(0)); }

std::string usual_svbuild() { return program_beside_this("svbuild"); }

Result<ConvertedFile> convert(const ConversionRequest& request,
                              const std::function<void(const ConversionProgress&)>& tell, const std::string& svbuild) {
  auto started = RunningProgram::start(command_of(request, svbuild));
  if (!started) return fail_no_svbuild(request.inputs[0], started.error().message);
  std::unique_ptr<RunningProgram> program = std::move(*started);
  ConversionProgress progress;
  while (!program->is_silent()) {
    SPLATVOL_TRY(check_interruption());
    const auto line = program->read_line(interruption_delay);
    if (!line) continue;
    const auto told = read_json(*line, read_line, 8);
    if (!told) return fail_in("svbuild, which is of another version,", told.error());
    if (!told->error.empty()) return fail(ErrorCode::invalid_data, "{}", told->error);
    if (told->result) return with_lease(std::move(*told->result), std::move(program));
    const bool has_preview = progress.has_preview || told->has_preview;
    if (told->progress) progress = *told->progress;
    progress.has_preview = has_preview;
    if (tell) tell(progress);
  }
  return fail_early_end(request.inputs[0], *program);
}

format::OpenFile open_as(const std::string& mesh, const ConvertedFile& converted, format::OpenFile open) {
  return [=, path = converted.path](const std::string& file) -> Result<std::unique_ptr<ByteSource>> {
    SPLATVOL_TRY_ASSIGN(source, open(file));
    if (file != path) return source;  // one of its steps
    return std::make_unique<NamedSource>(std::move(source), mesh);
  };
}

Status forget_converted(const std::vector<std::string>& inputs, const std::string& svbuild) {
  std::vector<std::string> words = {svbuild, "--forget", "--"};
  words.insert(words.end(), inputs.begin(), inputs.end());
  const int code = run_program(words);
  if (code == no_program) return fail_no_svbuild(inputs[0], "cannot start " + svbuild);
  return code == 0
             ? Status{}
             : fail(ErrorCode::io, "{}: the cache still has it: svbuild --forget {} tells why", inputs[0], inputs[0]);
}

}  // namespace splatvol
