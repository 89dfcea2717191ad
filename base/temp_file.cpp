#include "base/temp_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>

#include "base/descriptor.h"

namespace splatvol {
namespace {

// If the file system has no files without a name, makes one with a name and removes the name at once.
int open_unnamed(const std::string& folder) {
  const int descriptor = uninterrupted([&] { return ::open(folder.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600); });
  if (descriptor >= 0 || (errno != EOPNOTSUPP && errno != EISDIR)) return descriptor;
  std::string path = folder + "/splatvol-XXXXXX";
  const int named = ::mkostemp(path.data(), O_CLOEXEC);
  if (named >= 0) (void)uninterrupted([&] { return ::unlink(path.c_str()); });
  return named;
}

}  // namespace

Result<TempFile> TempFile::create(const std::string& folder) {
  const int descriptor = open_unnamed(folder);
  if (descriptor < 0) return fail_errno(folder, "cannot create a temporary file");
  return TempFile(descriptor, folder);
}

TempFile::TempFile(TempFile&& other) noexcept
    : descriptor_(std::exchange(other.descriptor_, -1)), folder_(std::move(other.folder_)), size_(other.size_) {}

TempFile& TempFile::operator=(TempFile&& other) noexcept {
  std::swap(descriptor_, other.descriptor_);
  std::swap(folder_, other.folder_);
  std::swap(size_, other.size_);
  return *this;
}

TempFile::~TempFile() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

Status TempFile::append(std::span<const std::byte> bytes) {
  if (!write_fully(descriptor_, size_, bytes)) return fail_errno(folder_, "cannot write a temporary file");
  size_ += bytes.size();
  return {};
}

Status TempFile::read(std::uint64_t offset, std::span<std::byte> out) const {
  if (offset > size_ || out.size() > size_ - offset)
    return fail(ErrorCode::invalid_argument, "{}: {} bytes at {} are past the end of a temporary file ({} bytes)",
                folder_, out.size(), offset, size_);
  return read_fully(descriptor_, offset, out) ? Status{} : fail_errno(folder_, "cannot read a temporary file");
}

void TempFile::release([[maybe_unused]] std::uint64_t offset, [[maybe_unused]] std::uint64_t bytes) {
#ifdef __linux__
  // A failure costs disk space only.
  (void)!::fallocate(descriptor_, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, static_cast<off_t>(offset),
                     static_cast<off_t>(bytes));
#endif
}

Result<std::uint64_t> free_disk_bytes(const std::string& folder) {
  std::error_code error;
  const std::filesystem::space_info space = std::filesystem::space(folder, error);
  if (error) return fail(ErrorCode::io, "{}: {}", folder, error.message());
  return space.available;
}

}  // namespace splatvol
