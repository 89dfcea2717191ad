#include "base/file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>

#include "base/descriptor.h"

namespace splatvol {
namespace {

constexpr std::uint64_t max_text_bytes = 64u << 20;  // scenes and mesh headers are a few kilobytes

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
  // The system would end the name there, and open another file.
  if (path.find('\0') != std::string::npos)
    return fail(ErrorCode::invalid_argument, "{}: no name of a file holds the character NUL", path);
  // Without O_NONBLOCK, opening a pipe that has no writer would wait for ever.
  const int descriptor = uninterrupted([&] { return ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK); });
  if (descriptor < 0) return fail_errno(path, "cannot open");
  struct stat status {};
  if (::fstat(descriptor, &status) != 0 || !S_ISREG(status.st_mode)) {
    ::close(descriptor);
    return fail(ErrorCode::io, "{}: not a regular file", path);
  }
  return std::make_unique<FileSource>(descriptor, static_cast<std::uint64_t>(status.st_size), path);
}

Result<std::string> read_text_file(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(source, open_file(path));
  if (source->size() > max_text_bytes)
    return fail(ErrorCode::invalid_data, "{}: {} bytes are no text file", path, source->size());
  std::string text(static_cast<std::size_t>(source->size()), '\0');
  SPLATVOL_TRY(source->read(0, std::as_writable_bytes(std::span(text))));
  return text;
}

}  // namespace splatvol
