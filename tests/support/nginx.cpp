#include "tests/support/nginx.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <thread>

#include "tests/support/loopback.h"

namespace splatvol::test {
namespace {

// Returns the path of nginx, or "" if there is none. Debian puts it in a folder that only root searches.
std::string find_nginx() {
  const char* const path = std::getenv("PATH");
  std::istringstream folders(std::string(path != nullptr ? path : "") + ":/usr/sbin:/usr/local/sbin");
  for (std::string folder; std::getline(folders, folder, ':');)
    if (::access((folder + "/nginx").c_str(), X_OK) == 0) return folder + "/nginx";
  return "";
}

std::string configuration(const std::string& folder, int port) {
  std::string temporary;
  for (const char* kind : {"client_body", "proxy", "fastcgi", "uwsgi", "scgi"})
    temporary += fmt::format("  {}_temp_path nginx-temporary;\n", kind);
  return fmt::format(R"(daemon off;
master_process off;
pid nginx.pid;
error_log error.log;
events {{}}
http {{
{}  log_format answer '$status $body_bytes_sent $http_range';
  access_log access.log answer;
  server {{
    listen 127.0.0.1:{};
    root '{}';
    location /plain/ {{ alias '{}/'; max_ranges 0; }}
  }}
}}
)",
                     temporary, port, folder, folder);
}

}  // namespace

std::unique_ptr<Nginx> Nginx::start(const std::string& folder) {
  const std::string program = find_nginx();
  if (program.empty()) return nullptr;
  const std::string pid_file = folder + "/nginx.pid";  // nginx writes it when it listens
  const std::string prefix = folder + "/";
  const std::string error_log = folder + "/error.log";
  for (int attempt = 0; attempt < 10; ++attempt) {
    const Listener free = listen_on_loopback();
    ::close(free.descriptor);
    std::ofstream(folder + "/nginx.conf") << configuration(folder, free.port);
    const pid_t parent = ::getpid();
    const pid_t process = ::fork();
    if (process == 0) {
      ::prctl(PR_SET_PDEATHSIG, SIGKILL);
      if (::getppid() == parent)
        ::execl(program.c_str(), "nginx", "-p", prefix.c_str(), "-c", "nginx.conf", "-e", error_log.c_str(), nullptr);
      ::_exit(127);
    }
    // nginx ends if another process has taken the port.
    while (::waitpid(process, nullptr, WNOHANG) == 0) {
      if (std::filesystem::exists(pid_file)) return std::unique_ptr<Nginx>(new Nginx(process, free.port));
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  }
  throw std::runtime_error("nginx does not start; see " + error_log);
}

Nginx::~Nginx() {
  ::kill(process_, SIGTERM);
  ::waitpid(process_, nullptr, 0);
}

std::string Nginx::url(const std::string& name) const { return fmt::format("http://127.0.0.1:{}/{}", port_, name); }

}  // namespace splatvol::test
