// Reads files of foreign formats in a process of its own.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "base/triangle_mesh.h"
#include "builder/sources/array_union.h"
#include "builder/sources/source.h"

namespace splatvol {

struct ReaderProcessOptions {
  std::string program;                 // the path of splatvol-read
  std::uint64_t memory;                // bytes of data that the process may have
  std::chrono::seconds patience{300};  // how long it may read nothing from its files, and send nothing
  double factor = 1;                   // on how much it may read, and on how long it may take
  int threads = 0;                     // most threads; 0: those of the machine
  /// Gets the share of the bytes of its inputs that the process has read, some times a second while somebody waits for
  /// it. It may stay below 1: of an input with time steps, one is read.
  std::function<void(double)> progress = {};
};

/// The files and folders that a reader process has opened.
struct ReadFiles {
  std::set<std::string> opened, missing;  // missing: it looked for them
  bool are_all = true;
};

/// Opens sources and reads surfaces in a process of its own, so that a damaged or hostile file does no harm: libraries
/// of formats crash, loop for ever and take all memory there. The process starts with the first of them. It ends with
/// this object and the last source. Not thread-safe, and neither are two of its sources.
///
/// The process may read 64 times the bytes of its inputs and 1 GiB, and take 1 s for each MB of them and 600 s. Each
/// source and each surface adds its input (input_bytes.h). Only the time in which somebody waits for it counts.
class ReaderProcess {
 public:
  explicit ReaderProcess(ReaderProcessOptions options);
  ~ReaderProcess();
  ReaderProcess(const ReaderProcess&) = delete;
  ReaderProcess& operator=(const ReaderProcess&) = delete;

  /// Contract as open_source (builder/opening/open_source.h), and all functions of the source as Source. They fail too
  /// if the process crashes, needs more memory, or does not get on.
  [[nodiscard]] Result<std::unique_ptr<Source>> open(const std::vector<std::string>& inputs,
                                                     const SourceOptions& options);

  /// Contract as list_arrays (builder/opening/open_source.h). Fails too if the process crashes, needs more memory, or
  /// does not get on.
  [[nodiscard]] Result<std::optional<std::vector<ArrayShape>>> list_arrays(const std::vector<std::string>& inputs,
                                                                           const SourceOptions& options);

  /// Reads the triangles of a file. Contract as read_surface_file (builder/sources/surfaces/surface_file.h). Fails too
  /// if the process crashes, needs more memory, or does not get on.
  [[nodiscard]] Result<TriangleMesh> read_surface(const std::string& path);

  /// What was read for all sources so far. Empty where the system cannot tell.
  [[nodiscard]] const ReadFiles& files() const { return *files_; }

 private:
  [[nodiscard]] Status start();

  class Process;
  friend class ProcessSource;

  ReaderProcessOptions options_;
  std::shared_ptr<Process> process_;  // null: not started
  std::uint64_t sources_ = 0;         // opened so far
  std::shared_ptr<ReadFiles> files_ = std::make_shared<ReadFiles>();
};

}  // namespace splatvol
