// Files on web servers, read piece by piece over HTTP range requests.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <string>

#include "base/error.h"
#include "base/file.h"

namespace splatvol {

/// How patient a source is with its server.
struct HttpOptions {
  int attempts = 4;                                // at a read, while failures may pass: resets, timeouts, 5xx, 429
  std::chrono::milliseconds first_wait{250};       // before the second attempt; doubles from one to the next
  std::chrono::milliseconds longest_wait{60'000};  // a server that asks for a longer one (Retry-After) is given up
  std::chrono::milliseconds connect_timeout{10'000};
  std::chrono::seconds stall_timeout{30};                    // in which nothing arrives
  std::function<void(std::chrono::milliseconds)> wait = {};  // how to let time pass; empty: sleep
};

/// Opens what a web server holds under an address (http:// or https://), and reads its first 32 KiB, which are kept.
///
/// Each read is a request for a range of bytes, on a connection that is kept for the next one; reads at the same time
/// have a connection each. Proxies are those of the environment (http_proxy and so on); redirects are followed. Fails
/// with one line where the server cannot be reached or does not have the file, or does not serve ranges (of whose
/// answer nothing is downloaded). A read fails where the file is not the one of the first answer any more: another
/// size, or another ETag (Last-Modified where there is none). Trusts nothing that the server says about ranges.
///
/// The source's name, and so its messages, lack what may be secret: user, password, query.
[[nodiscard]] Result<std::unique_ptr<ByteSource>> open_url(const std::string& url, const HttpOptions& options = {});

/// Opens an address that begins with http:// or https://, or else the file of that name.
[[nodiscard]] Result<std::unique_ptr<ByteSource>> open_file_or_url(const std::string& path_or_url);

}  // namespace splatvol
