#include "base/file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <random>
#include <vector>

namespace splatvol {
namespace {

constexpr std::uint64_t max_text_bytes = 64u << 20;  // scenes and mesh headers are a few kilobytes
constexpr std::uint64_t begun_together = 32u << 20;
constexpr std::uint64_t moved_together = 4u << 20;

tl::unexpected<Error> fail_errno(const std::string& path, const char* action) {
  return fail(ErrorCode::io, "{}: {}: {}", path, action, std::strerror(errno));
}

std::string unpredictable_name(const std::string& path) {
  std::random_device random;
  return fmt::format("{}.{:08x}{:08x}", path, random(), random());
}

Status read_exactly(int descriptor, std::uint64_t offset, std::span<std::byte> out, const std::string& path) {
  while (!out.empty()) {
    const ssize_t got = ::pread(descriptor, out.data(), out.size(), static_cast<off_t>(offset));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return fail_errno(path, "cannot read");
    if (got == 0) return fail(ErrorCode::io, "{}: the file became shorter while it was open", path);
    out = out.subspan(static_cast<std::size_t>(got));
    offset += static_cast<std::uint64_t>(got);
  }
  return {};
}

class FileSource final : public ByteSource {
 public:
  FileSource(int descriptor, std::uint64_t size, std::string path)
      : descriptor_(descriptor), size_(size), path_(std::move(path)) {}
  FileSource(const FileSource&) = delete;
  FileSource& operator=(const FileSource&) = delete;
  ~FileSource() override { ::close(descriptor_); }

  std::uint64_t size() const override { return size_; }
  const std::string& name() const override { return path_; }

  Status read(std::uint64_t offset, std::span<std::byte> out) override {
    if (offset > size_ || out.size() > size_ - offset)
      return fail(ErrorCode::invalid_data, "{}: {} bytes at {} are past the end of the file ({} bytes)", path_,
                  out.size(), offset, size_);
    return read_exactly(descriptor_, offset, out, path_);
  }

 private:
  int descriptor_;
  std::uint64_t size_;
  std::string path_;
};

class MemorySource final : public ByteSource {
 public:
  MemorySource(std::span<const std::byte> bytes, std::string name) : bytes_(bytes), name_(std::move(name)) {}
  std::uint64_t size() const override { return bytes_.size(); }
  const std::string& name() const override { return name_; }
  Status read(std::uint64_t offset, std::span<std::byte> out) override {
    if (offset > bytes_.size() || out.size() > bytes_.size() - offset)
      return fail(ErrorCode::invalid_data, "{}: {} bytes at {} are past the end ({} bytes)", name_, out.size(), offset,
                  bytes_.size());
    std::ranges::copy(bytes_.subspan(offset, out.size()), out.begin());
    return {};
  }

 private:
  std::span<const std::byte> bytes_;
  std::string name_;
};

}  // namespace

std::string folder_of(const std::string& path) {
  const std::string folder = std::filesystem::path(path).parent_path();
  return folder.empty() ? "." : folder;
}

Result<std::unique_ptr<ByteSource>> open_file(const std::string& path) {
  // Without O_NONBLOCK, a pipe nobody writes to would keep us here for ever.
  const int descriptor = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (descriptor < 0) return fail_errno(path, "cannot open");
  struct stat status {};
  if (::fstat(descriptor, &status) != 0 || !S_ISREG(status.st_mode)) {
    ::close(descriptor);
    return fail(ErrorCode::io, "{}: not a regular file", path);
  }
  return std::make_unique<FileSource>(descriptor, static_cast<std::uint64_t>(status.st_size), path);
}

std::unique_ptr<ByteSource> memory_source(std::span<const std::byte> bytes, std::string name) {
  return std::make_unique<MemorySource>(bytes, std::move(name));
}

Result<std::string> read_text_file(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(source, open_file(path));
  if (source->size() > max_text_bytes)
    return fail(ErrorCode::invalid_data, "{}: {} bytes are no text file", path, source->size());
  std::string text(source->size(), '\0');
  SPLATVOL_TRY(source->read(0, std::as_writable_bytes(std::span(text))));
  return text;
}

Result<AtomicFile> AtomicFile::create(const std::string& target) {
  // The rename would put a regular file in the place of a device or a pipe. A link is followed.
  std::error_code error;
  const auto status = std::filesystem::status(target, error);
  if (std::filesystem::exists(status) && !std::filesystem::is_regular_file(status))
    return fail(ErrorCode::io, "{}: not a regular file", target);
  const std::string path =
      std::filesystem::is_symlink(target, error) ? std::filesystem::weakly_canonical(target, error).string() : target;

  const int descriptor = ::open(folder_of(path).c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0666);
  if (descriptor >= 0) return AtomicFile(descriptor, path, "");
  if (errno != EOPNOTSUPP && errno != EISDIR) return fail_errno(path, "cannot create");
  for (;;) {
    std::string temporary = unpredictable_name(path);
    const int named = ::open(temporary.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (named >= 0) return AtomicFile(named, path, std::move(temporary));
    if (errno != EEXIST) return fail_errno(path, "cannot create");
  }
}

AtomicFile::AtomicFile(int descriptor, std::string path, std::string temporary_path)
    : descriptor_(descriptor), path_(std::move(path)), temporary_path_(std::move(temporary_path)) {}

AtomicFile::AtomicFile(AtomicFile&& other) noexcept
    : descriptor_(std::exchange(other.descriptor_, -1)),
      path_(std::move(other.path_)),
      temporary_path_(std::move(other.temporary_path_)),
      end_(other.end_),
      begun_(other.begun_) {}

AtomicFile::~AtomicFile() {
  if (descriptor_ < 0) return;
  ::close(descriptor_);
  if (!temporary_path_.empty()) ::unlink(temporary_path_.c_str());
}

Status AtomicFile::append(std::span<const std::byte> bytes) {
  SPLATVOL_TRY(write_at(end_, bytes));
  end_ += bytes.size();
  if (end_ >= begun_ + begun_together) {
    // Otherwise all of it would wait until commit. Nothing is lost where this fails.
    (void)::sync_file_range(descriptor_, static_cast<off_t>(begun_), static_cast<off_t>(end_ - begun_),
                            SYNC_FILE_RANGE_WRITE);
    begun_ = end_;
  }
  return {};
}

Status AtomicFile::insert_front(std::uint64_t bytes) {
  std::uint64_t left = std::exchange(end_, end_ + bytes);
  begun_ = end_;
  if (bytes == 0 || left == 0) return {};
  if (::fallocate(descriptor_, FALLOC_FL_INSERT_RANGE, 0, static_cast<off_t>(bytes)) == 0) return {};

  // Block by block from the end, so that none is overwritten before it is read.
  std::vector<std::byte> block(std::min(left, moved_together));
  while (left > 0) {
    const auto part = std::span(block).first(std::min<std::uint64_t>(left, block.size()));
    left -= part.size();
    SPLATVOL_TRY(read_exactly(descriptor_, left, part, path_));
    SPLATVOL_TRY(write_at(left + bytes, part));
  }
  return {};
}

Status AtomicFile::write_at(std::uint64_t offset, std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    const ssize_t put = ::pwrite(descriptor_, bytes.data(), bytes.size(), static_cast<off_t>(offset));
    if (put < 0 && errno == EINTR) continue;
    if (put < 0) return fail_errno(path_, "cannot write");
    bytes = bytes.subspan(static_cast<std::size_t>(put));
    offset += static_cast<std::uint64_t>(put);
  }
  return {};
}

std::string AtomicFile::path_to_write() const {
  return temporary_path_.empty() ? fmt::format("/proc/self/fd/{}", descriptor_) : temporary_path_;
}

Status AtomicFile::commit() {
  if (::fsync(descriptor_) != 0) return fail_errno(path_, "cannot sync");
  // A link cannot replace a file; a name of its own can be renamed over it.
  const std::string self = path_to_write();
  while (temporary_path_.empty()) {
    std::string name = unpredictable_name(path_);
    if (::linkat(AT_FDCWD, self.c_str(), AT_FDCWD, name.c_str(), AT_SYMLINK_FOLLOW) == 0)
      temporary_path_ = std::move(name);
    else if (errno != EEXIST)
      return fail_errno(path_, "cannot name");
  }
  if (::rename(temporary_path_.c_str(), path_.c_str()) != 0) return fail_errno(path_, "cannot rename to");
  ::close(std::exchange(descriptor_, -1));

  // The rename itself lasts through a power cut only when the folder is synced too.
  const int directory = ::open(folder_of(path_).c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (directory < 0) return fail_errno(path_, "cannot sync the folder of");
  const int synced = ::fsync(directory);
  ::close(directory);
  return synced == 0 ? Status{} : fail_errno(path_, "cannot sync the folder of");
}

Status write_text_file(const std::string& path, const std::string& text) {
  SPLATVOL_TRY_ASSIGN(file, AtomicFile::create(path));
  SPLATVOL_TRY(file.append(std::as_bytes(std::span(text))));
  return file.commit();
}

}  // namespace splatvol
