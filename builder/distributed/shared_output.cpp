#include "builder/distributed/shared_output.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <string_view>
#include <utility>

#include "base/descriptor.h"
#include "base/temporary_names.h"

namespace splatvol {
namespace {

constexpr std::string_view processes = "/proc/";

// The path by which other processes of this machine find a file without a name.
std::string path_for_others(const std::string& path) {
  constexpr std::string_view self = "/proc/self/";
  return path.starts_with(self) ? fmt::format("{}{}/{}", processes, ::getpid(), path.substr(self.size())) : path;
}

std::string text_of(const Bytes& bytes) { return {reinterpret_cast<const char*>(bytes.data()), bytes.size()}; }

Bytes bytes_of(const std::string& text) {
  const auto raw = std::as_bytes(std::span(text));
  return {raw.begin(), raw.end()};
}

}  // namespace

SharedOutput::SharedOutput(SharedOutput&& other) noexcept
    : target_(std::move(other.target_)),
      file_(std::move(other.file_)),
      noted_(std::exchange(other.noted_, {})),
      descriptor_(std::exchange(other.descriptor_, -1)),
      on_one_machine_(other.on_one_machine_),
      not_begun_(other.not_begun_) {}

SharedOutput::~SharedOutput() {
  if (descriptor_ >= 0) ::close(descriptor_);
  if (!noted_.empty()) forget_temporary(noted_);
}

Result<SharedOutput> SharedOutput::create(Ranks& ranks, const std::string& target) {
  using Unnamed = AtomicFile::Unnamed;
  for (const bool named : {false, true}) {
    if (!named && !ranks.on_one_machine()) continue;
    const auto create_on_first = [&]() -> Result<std::optional<AtomicFile>> {
      if (!ranks.is_first()) return std::nullopt;
      SPLATVOL_TRY_ASSIGN(made, AtomicFile::create(target, named ? Unnamed::never : Unnamed::if_possible));
      return std::optional(std::move(made));
    };
    SPLATVOL_TRY_ASSIGN(file, ranks.agree_on(create_on_first()));
    SharedOutput output(target, std::move(file), ranks.on_one_machine());
    const Status opened = open_on_all(ranks, output, named);
    if (opened) return output;
    if (named) return tl::unexpected<Error>(opened.error());
  }
  return fail(ErrorCode::io, "{}: cannot create", target);
}

// The ranks agree on the failure if the file is named: that is the last attempt.
Status SharedOutput::open_on_all(Ranks& ranks, SharedOutput& output, bool named) {
  const std::string path =
      text_of(ranks.broadcast(output.file_ ? bytes_of(path_for_others(output.file_->path_to_write())) : Bytes{}));
  output.descriptor_ = uninterrupted([&] { return ::open(path.c_str(), O_RDWR | O_CLOEXEC); });
  Status opened;
  if (output.descriptor_ < 0) opened = fail_errno(output.target_, "another rank's file cannot be opened");
  if (named) {
    SPLATVOL_TRY(ranks.agree(opened));
  } else {
    std::uint64_t failures = opened ? 0 : 1;
    ranks.sum({&failures, 1});
    if (failures > 0) return fail(ErrorCode::io, "{}: not open on all ranks", output.target_);
  }
  // Some file systems have no files without a name.
  const bool has_name = !path.starts_with(processes);
  if (has_name && !output.file_) note_temporary(output.noted_ = path);
  return {};
}

Status SharedOutput::write_at(std::uint64_t offset, std::span<const std::byte> bytes) {
  if (!write_fully(descriptor_, offset, bytes)) return fail_errno(target_, "cannot write");
  not_begun_ += bytes.size();
  // Without this, the disk might write everything only when the file is committed. A failure costs time only.
  constexpr std::uint64_t begun_together = std::uint64_t{8} << 20;
  if (not_begun_ >= begun_together) {
    (void)::sync_file_range(descriptor_, 0, 0, SYNC_FILE_RANGE_WRITE);
    not_begun_ = 0;
  }
  return {};
}

Status SharedOutput::sync() const {
  // Rank 0 syncs the whole file when it commits it.
  if (on_one_machine_) return {};
  return sync_fully(descriptor_) ? Status{} : fail_errno(target_, "cannot sync");
}

}  // namespace splatvol
