// The files that base/file.h writes.
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <vector>

#include "base/descriptor.h"
#include "base/file.h"
#include "base/replaceable.h"
#include "base/temporary_names.h"

namespace splatvol {
namespace {

constexpr std::uint64_t begun_together = 32u << 20;
constexpr std::uint64_t moved_together = 4u << 20;

// Returns the rights of a file that replaces one. Others never get more than that one gave them. This holds, too, where
// the new file cannot have its group.
mode_t rights_for(int descriptor, const FileRights& rights) {
  const auto give_to = [&](uid_t owner) {
    return uninterrupted([&] { return ::fchown(descriptor, owner, rights.group); }) == 0;
  };
  if (::geteuid() == 0 && give_to(rights.owner)) return rights.mode;
  if (give_to(static_cast<uid_t>(-1))) return rights.mode;
  return (rights.mode & ~mode_t{070}) | ((rights.mode & 07) << 3);
}

bool give_rights(int descriptor, const FileRights& rights) {
  const mode_t mode = rights_for(descriptor, rights);
  return uninterrupted([&] { return ::fchmod(descriptor, mode); }) == 0;
}

}  // namespace

Status make_folder(const std::string& path) {
  std::error_code error;
  if (std::filesystem::create_directories(path, error) || std::filesystem::is_directory(path)) return {};
  return fail(ErrorCode::io, "{}: cannot make this folder: {}", path, error ? error.message() : "a file has its name");
}

Result<AtomicFile> AtomicFile::create(const std::string& target, Unnamed unnamed, Replace replace) {
  struct stat status {};
  const bool exists = ::stat(target.c_str(), &status) == 0;
  // Names that are too long, links in a circle, folders without access: better now than after hours of work.
  if (!exists && errno != ENOENT) return fail_errno(target, "cannot create");
  // Renaming would replace a device or a pipe by a regular file.
  if (exists && !S_ISREG(status.st_mode)) return fail(ErrorCode::io, "{}: not a regular file", target);
  SPLATVOL_TRY(check_replaceable(target, replace));
  // Links are followed, also to a file that is not there yet. Links in a circle were refused above.
  std::filesystem::path path = target;
  std::error_code error;
  while (std::filesystem::is_symlink(path, error))
    path = path.parent_path() / std::filesystem::read_symlink(path, error);

  std::optional<FileRights> rights;
  if (exists) rights = {status.st_mode & 0777, status.st_uid, status.st_gid};
  SPLATVOL_TRY_ASSIGN(file, create_beside(path.string(), unnamed, rights));
  file.replace_ = replace;
  return file;
}

Result<AtomicFile> AtomicFile::create_beside(const std::string& path, Unnamed unnamed,
                                             const std::optional<FileRights>& rights) {
  const mode_t mode = rights ? 0600 : 0666;
  const std::string folder = folder_of(path);
  const auto open_unnamed = [&] { return ::open(folder.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, mode); };
  const int descriptor = unnamed == Unnamed::if_possible ? uninterrupted(open_unnamed) : (errno = EOPNOTSUPP, -1);
  if (descriptor >= 0) {
    AtomicFile file(descriptor, path, "", rights);
    // Without /proc, a file without a name could not get one.
    if (::access(file.path_to_write().c_str(), F_OK) == 0) return file;
    errno = EOPNOTSUPP;
  }
  if (errno != EOPNOTSUPP && errno != EISDIR) return fail_errno(path, "cannot create");
  for (;;) {
    std::string temporary = temporary_name_beside(path);
    const int named =
        uninterrupted([&] { return ::open(temporary.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, mode); });
    if (named < 0 && errno == EEXIST) continue;
    if (named < 0) return fail_errno(path, "cannot create");
    note_temporary(temporary);
    return AtomicFile(named, path, std::move(temporary), rights);
  }
}

AtomicFile::AtomicFile(int descriptor, std::string path, std::string temporary_path,
                       const std::optional<FileRights>& rights)
    : descriptor_(descriptor), path_(std::move(path)), temporary_path_(std::move(temporary_path)), rights_(rights) {}

AtomicFile::AtomicFile(AtomicFile&& other) noexcept
    : descriptor_(std::exchange(other.descriptor_, -1)),
      path_(std::move(other.path_)),
      temporary_path_(std::move(other.temporary_path_)),
      rights_(other.rights_),
      end_(other.end_),
      begun_(other.begun_),
      replace_(other.replace_) {}

AtomicFile::~AtomicFile() {
  if (descriptor_ >= 0) ::close(descriptor_);
  if (temporary_path_.empty()) return;
  (void)uninterrupted([&] { return ::unlink(temporary_path_.c_str()); });
  forget_temporary(temporary_path_);
}

Status AtomicFile::append(std::span<const std::byte> bytes) {
  SPLATVOL_TRY(write_at(end_, bytes));
  end_ += bytes.size();
  if (end_ >= begun_ + begun_together) {
#ifdef __linux__
    // Without this, the disk might write everything only at commit. A failure costs time only.
    (void)::sync_file_range(descriptor_, static_cast<off_t>(begun_), static_cast<off_t>(end_ - begun_),
                            SYNC_FILE_RANGE_WRITE);
#endif
    begun_ = end_;
  }
  return {};
}

Status AtomicFile::insert_front(std::uint64_t bytes) {
  std::uint64_t left = std::exchange(end_, end_ + bytes);
  begun_ = end_;
  if (bytes == 0 || left == 0) return {};
#ifdef __linux__
  if (::fallocate(descriptor_, FALLOC_FL_INSERT_RANGE, 0, static_cast<off_t>(bytes)) == 0) return {};
#endif

  // Part by part from the end, so that no part is overwritten before it is read.
  std::vector<std::byte> buffer(static_cast<std::size_t>(std::min(left, moved_together)));
  while (left > 0) {
    const auto part = std::span(buffer).first(static_cast<std::size_t>(std::min<std::uint64_t>(left, buffer.size())));
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

// linkat cannot replace a file, rename can: so the file first gets a temporary name. Where the system allows no link to
// a file without a name, a copy gets it.
Status AtomicFile::give_temporary_name() {
  const std::string self = path_to_write();
  while (temporary_path_.empty()) {
    std::string name = temporary_name_beside(path_);
    const auto link = [&] { return ::linkat(AT_FDCWD, self.c_str(), AT_FDCWD, name.c_str(), AT_SYMLINK_FOLLOW); };
    if (const int error = uninterrupted(link) == 0 ? 0 : errno; error != 0 && !is_named(descriptor_, name)) {
      if (error == EEXIST) continue;
      return copy_to_named();
    }
    note_temporary(name);
    temporary_path_ = std::move(name);
  }
  return {};
}

Status AtomicFile::copy_to_named() {
  SPLATVOL_TRY_ASSIGN(copy, create_beside(path_, Unnamed::never, rights_));
  const off_t size = ::lseek(descriptor_, 0, SEEK_END);
  std::vector<std::byte> buffer(moved_together);
  for (std::uint64_t at = 0; at < static_cast<std::uint64_t>(size); at += buffer.size()) {
    buffer.resize(
        static_cast<std::size_t>(std::min<std::uint64_t>(buffer.size(), static_cast<std::uint64_t>(size) - at)));
    SPLATVOL_TRY(read_exactly(descriptor_, at, buffer, path_));
    SPLATVOL_TRY(copy.write_at(at, buffer));
  }
  std::swap(descriptor_, copy.descriptor_);
  std::swap(temporary_path_, copy.temporary_path_);
  return sync_fully(descriptor_) ? Status{} : fail_errno(path_, "cannot sync");
}

// All but the name.
Status AtomicFile::complete() {
  SPLATVOL_TRY(check_replaceable(path_, replace_));  // another program may have written it meanwhile
  if (!sync_fully(descriptor_)) return fail_errno(path_, "cannot sync");
  SPLATVOL_TRY(give_temporary_name());
  // Only the owner could read it until now. Where the system does not allow more, that stays.
  if (rights_) (void)give_rights(descriptor_, *rights_);
  return {};
}

// Returns false, with errno set, if the system refuses. A call that a signal interrupts, or whose answer a server
// loses, may have done its work all the same.
bool AtomicFile::rename_to_target() {
  const auto rename = [&] { return ::rename(temporary_path_.c_str(), path_.c_str()); };
  if (const int error = uninterrupted(rename) == 0 ? 0 : errno; error != 0 && !is_named(descriptor_, path_)) {
    errno = error;
    return false;
  }
  forget_temporary(temporary_path_);
  temporary_path_.clear();
  ::close(std::exchange(descriptor_, -1));
  return true;
}

Status AtomicFile::commit_unconfirmed() {
  SPLATVOL_TRY(complete());
  return rename_to_target() ? Status{} : fail_errno(path_, "cannot rename to");
}

Status AtomicFile::commit() {
  const std::string folder = folder_of(path_);  // no memory is taken once the file has its name
  SPLATVOL_TRY(complete());
  if (!rename_to_target()) {
    // The work of hours is complete: it stays under the name that it has.
    const Status failure = fail_errno(path_, "cannot rename to");
    forget_temporary(temporary_path_);
    return fail(ErrorCode::io, "{}; the finished file is {}", failure.error().message,
                std::exchange(temporary_path_, {}));
  }
  if (is_noted_temporary(path_)) return {};
  const Status confirmed = sync_folder(folder);
  if (confirmed) return {};
  return fail(ErrorCode::io, "{}: is complete and has its name, though the disk has not confirmed the name: {}", path_,
              confirmed.error().message);
}

Status sync_folder(const std::string& folder) {
  const int directory = uninterrupted([&] { return ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC); });
  if (directory < 0 && errno == EACCES) return {};
  if (directory < 0) return fail_errno(folder, "cannot sync");
  Status result =
      sync_fully(directory) || errno == EINVAL || errno == ENOTSUP ? Status{} : fail_errno(folder, "cannot sync");
  ::close(directory);
  return result;
}

Result<bool> rename_if_free(const std::string& from, const std::string& to) {
  const auto exists = [](const std::string& path) {
    struct stat status {};
    return ::lstat(path.c_str(), &status) == 0;
  };
#ifdef RENAME_NOREPLACE
  const auto rename = [&] { return ::renameat2(AT_FDCWD, from.c_str(), AT_FDCWD, to.c_str(), RENAME_NOREPLACE); };
  if (uninterrupted(rename) == 0) return true;
#else
  errno = ENOSYS;
#endif
  // Some file systems, such as NFS, cannot look and rename at once.
  if ((errno == EINVAL || errno == ENOSYS) && !exists(to) &&
      uninterrupted([&] { return ::rename(from.c_str(), to.c_str()); }) == 0)
    return true;
  const int error = errno;
  if (exists(to)) return !exists(from);  // an interrupted call may have done its work
  errno = error;
  return fail_errno(from, "cannot rename");
}

Status write_text_file(const std::string& path, const std::string& text) {
  SPLATVOL_TRY_ASSIGN(file, AtomicFile::create(path));
  SPLATVOL_TRY(file.append(std::as_bytes(std::span(text))));
  return file.commit();
}

}  // namespace splatvol
