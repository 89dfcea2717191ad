#include "base/addresses.h"

#include "base/http_source.h"
#include "base/input_formats.h"
#include "base/sftp_source.h"

namespace splatvol {

Result<std::unique_ptr<ByteSource>> open_file_or_url(const std::string& path_or_url) {
  if (!is_url(path_or_url)) return open_file(path_or_url);
  if (format_of_name(path_or_url.substr(0, path_or_url.find('?'))))
    return fail(ErrorCode::unsupported, "{}: {}", path_or_url, no_far_mesh);
  return path_or_url.starts_with("ssh:") ? open_ssh(path_or_url) : open_url(path_or_url);
}

}  // namespace splatvol
