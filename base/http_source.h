// Files on web servers, read range by range over HTTP.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <string>
#include <string_view>

#include "base/error.h"
#include "base/file.h"
#include "base/server_file.h"

namespace splatvol {

/// How often and how long a source tries.
struct HttpOptions {
  int attempts = 4;                                // of a read, if the failure may pass: reset, timeout, 5xx, 429
  std::chrono::milliseconds first_wait{250};       // before the second attempt; doubles with each attempt
  std::chrono::milliseconds longest_wait{60'000};  // fails if the server asks for a longer wait (Retry-After)
  std::chrono::milliseconds connect_timeout{10'000};
  std::chrono::seconds stall_timeout = usual_stall_timeout;  // longest time below `slowest`
  long slowest = 1024;                                       // bytes a second
  std::function<void(std::chrono::milliseconds)> wait = {};  // called to wait; empty: sleeps
};

/// Opens the file at an address (http:// or https://). Reads its first 32 KiB and keeps them. Fails if the server
/// cannot be reached, does not have the file, or does not serve ranges; in this last case nothing is downloaded.
///
/// Each read is a request for a range of bytes. Its connection is kept for the next read; simultaneous reads have a
/// connection each. Uses the proxies of the environment (http_proxy and so on) and follows redirects. A read fails if
/// the file has changed since the first answer: another size, or another ETag (Last-Modified if there is no ETag).
/// Trusts nothing that the server says about ranges. Heeds base/interruption.h.
///
/// The source's name, and so its messages, leave out user, password and query, which may be secret.
[[nodiscard]] Result<std::unique_ptr<ByteSource>> open_url(const std::string& url, const HttpOptions& options = {});

/// Returns the protocols that a redirect from this address may lead to, separated by commas: what is asked for in
/// private is not fetched in public.
[[nodiscard]] const char* redirect_protocols(std::string_view url);

}  // namespace splatvol
