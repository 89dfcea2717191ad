#include "base/append_file.h"

#include <unistd.h>

#include "base/descriptor.h"

namespace splatvol {
Result<AppendFile> AppendFile::open(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(file, LockedFile::open(path, LockedFile::IfTaken::fail));
  AppendFile opened(std::move(file), path);
  const off_t end = ::lseek(opened.file_.descriptor(), 0, SEEK_END);
  if (end < 0) return fail_errno(path, "cannot find the end");
  opened.end_ = static_cast<std::uint64_t>(end);
  return opened;
}

Status AppendFile::read(std::uint64_t offset, std::span<std::byte> out) const {
  return read_exactly(file_.descriptor(), offset, out, path_);
}

Status AppendFile::cut(std::uint64_t bytes) {
  if (uninterrupted([&] { return ::ftruncate(file_.descriptor(), static_cast<off_t>(bytes)); }) != 0)
    return fail_errno(path_, "cannot cut off");
  end_ = bytes;
  return {};
}

Status AppendFile::append(std::span<const std::byte> bytes) {
  if (!write_fully(file_.descriptor(), end_, bytes)) return fail_errno(path_, "cannot write");
  end_ += bytes.size();
  return {};
}

Status AppendFile::sync() { return sync_fully(file_.descriptor()) ? Status{} : fail_errno(path_, "cannot sync"); }

Status AppendFile::replace_front(std::span<const std::byte> bytes) {
  // A call that fails may have written a part: only to write all of them again makes the file whole.
  for (int attempt = 0; attempt < 2; ++attempt)
    if (write_fully(file_.descriptor(), 0, bytes)) return {};
  return fail_errno(path_, "cannot write");
}

}  // namespace splatvol
