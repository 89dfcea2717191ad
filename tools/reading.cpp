#include "tools/reading.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <span>

#include "base/file.h"
#include "base/input_formats.h"
#include "base/memory_limit.h"
#include "base/printable.h"
#include "builder/opening/input_files.h"
#include "tools/tool.h"

namespace splatvol {

std::string find_program(const std::string& name) {
  std::error_code error;
  const std::filesystem::path folder = std::filesystem::read_symlink("/proc/self/exe", error).parent_path();
  const std::filesystem::path beside = folder / name, installed = folder / ".." / SPLATVOL_LIBEXEC / name;
  return std::filesystem::exists(beside, error) || !std::filesystem::exists(installed, error) ? beside : installed;
}

void add_reading_options(CommandLine& app, ReadingOptions& options) {
  app.add_option("--read-memory", options.memory,
                 "Memory for the libraries that read files of other formats, besides --memory; they run in a process "
                 "of their own (default: 3/4 of the machine's)")
      ->check(check_of(parse_bytes))
      ->type_name("SIZE");
  app.add_option("--read-timeout", options.seconds,
                 "Give up after this time without a byte read from the files and without a result, in seconds")
      ->range(1u, 1u << 20)
      ->capture_default_str()
      ->type_name("S");
  app.add_option("--read-factor", options.factor,
                 "Multiplies what may be read, 64 times the bytes of the files and 1 GiB, and how long that may take, "
                 "1 s for each MB of them and 600 s")
      ->range(1e-6, 1e6)
      ->capture_default_str()
      ->type_name("N");
}

Result<ReaderProcessOptions> reader_options_of(const ReadingOptions& options, unsigned threads) {
  ReaderProcessOptions of_process{.program = find_program("splatvol-read"), .memory = memory_limit() / 4 * 3};
  if (!options.memory.empty()) {
    SPLATVOL_TRY(store(parse_bytes(options.memory), of_process.memory));
  }
  of_process.patience = std::chrono::seconds(options.seconds);
  of_process.factor = options.factor;
  of_process.threads = static_cast<int>(threads);
  return of_process;
}

Status check_no_address(const std::vector<std::string>& inputs) {
  for (const std::string& input : inputs)
    if (is_url(input)) return fail(ErrorCode::unsupported, "{}: {}", input, no_far_mesh);
  return {};
}

std::string describe_left_out(const std::vector<std::string>& inputs) {
  constexpr std::size_t most_named = 8;
  const std::vector<std::string> files = files_left_out(inputs);
  if (files.empty()) return {};
  const std::span<const std::string> named = std::span(files).first(std::min(files.size(), most_named));
  const std::string more =
      files.size() > most_named ? fmt::format(" and {} more", files.size() - most_named) : std::string();
  return one_line(
      fmt::format("{}{}: left out of the folder, though their contents look like data: give them by name, "
                  "or move them",
                  fmt::join(named, ", "), more));
}

void warn_of_left_out(const std::vector<std::string>& inputs) {
  if (const std::string words = describe_left_out(inputs); !words.empty()) fmt::print(stderr, "warning: {}\n", words);
}

ReadSurface surface_reader(const ReaderProcessOptions& options) {
  return [reader = std::make_shared<ReaderProcess>(options)](const std::string& path) {
    auto mesh = reader->read_surface(path);
    if (mesh && mesh->open_end)
      fmt::print(
          stderr,
          "warning: {}: no line end follows its last number: it may be cut off; if it is whole, add a line end\n",
          one_line(path));
    return mesh;
  };
}

}  // namespace splatvol
