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

#include "base/descriptor.h"
#include "base/replaceable.h"

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
  if (read_fully(descriptor, offset, out)) return {};
  if (errno == 0) return fail(ErrorCode::io, "{}: the file became shorter while it was open", path);
  return fail_errno(path, "cannot read");
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
    SPLATVOL_TRY(check_range(*this, offset, out.size()));
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
    SPLATVOL_TRY(check_range(*this, offset, out.size()));
    std::ranges::copy(bytes_.subspan(offset, out.size()), out.begin());
    return {};
  }

 private:
  std::span<const std::byte> bytes_;
  std::string name_;
};

}  // namespace

Status check_range(const ByteSource& source, std::uint64_t offset, std::uint64_t count) {
  if (offset <= source.size() && count <= source.size() - offset) return {};
  return fail(ErrorCode::invalid_data, "{}: {} bytes at {} are past the end of the file ({} bytes)", source.name(),
              count, offset, source.size());
}

std::string folder_of(const std::string& path) {
  const std::string folder = std::filesystem::path(path).parent_path();
  return folder.empty() ? "." : folder;
}

Result<std::unique_ptr<ByteSource>> open_file(const std::string& path) {
  // Without O_NONBLOCK, opening a pipe that has no writer would wait for ever.
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
  // Renaming would replace a device or a pipe by a regular file.
  std::error_code error;
  const auto status = std::filesystem::status(target, error);
  if (std::filesystem::exists(status) && !std::filesystem::is_regular_file(status))
    return fail(ErrorCode::io, "{}: not a regular file", target);
  SPLATVOL_TRY(check_replaceable(target));
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
    // Without this, the disk might write everything only at commit. A failure costs time only.
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

  // Part by part from the end, so that no part is overwritten before it is read.
  std::vector<std::byte> buffer(std::min(left, moved_together));
  while (left > 0) {
    const auto part = std::span(buffer).first(std::min<std::uint64_t>(left, buffer.size()));
    left -= part.size();
    SPLATVOL_TRY(read_exactly(descriptor_, left, part, path_));
    SPLATVOL_TRY(write_at(left + bytes, part));
  }
  return {};
}

Status AtomicFile::write_at(std::uint64_t offset, std::span<const std::byte> bytes) {
  return write_fully(descriptor_, offset, bytes) ? Status{} : fail_errno(path_, "cannot write");
}

std::string AtomicFile::path_to_write() const {
  return temporary_path_.empty() ? fmt::format("/proc/self/fd/{}", descriptor_) : temporary_path_;
}

Status AtomicFile::commit() {
  SPLATVOL_TRY(check_replaceable(path_));  // another program may have written it meanwhile
  if (::fsync(descriptor_) != 0) return fail_errno(path_, "cannot sync");
  // linkat cannot replace a file, rename can: so the file first gets a temporary name.
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

  // Without syncing the folder, a power cut may undo the rename.
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
