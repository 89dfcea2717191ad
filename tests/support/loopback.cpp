#include "tests/support/loopback.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <cerrno>
#include <cstdlib>
#include <system_error>

namespace splatvol::test {

Listener listen_on_loopback() {
  ::setenv("no_proxy", "127.0.0.1", 1);  // a proxy has another loopback device
  const int descriptor = ::socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t length = sizeof(address);
  auto* const plain = reinterpret_cast<sockaddr*>(&address);
  if (::bind(descriptor, plain, length) != 0 || ::listen(descriptor, 64) != 0 ||
      ::getsockname(descriptor, plain, &length) != 0)
    throw std::system_error(errno, std::generic_category(), "cannot listen on 127.0.0.1");
  return {descriptor, ntohs(address.sin_port)};
}

}  // namespace splatvol::test
