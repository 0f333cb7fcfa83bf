// What the examples in docs/examples use of rclcpp 28.1, declared alone: there is no rclcpp among the wheels of ROS.
// The messages that it is compiled with are those of the project.
#pragma once
#include <chrono>
#include <cstdio>
#include <functional>
#include <future>
#include <memory>
#include <string>
namespace rclcpp
{
struct QoS
{
  explicit QoS(int) {}
  QoS & transient_local() {return *this;}
  QoS & best_effort() {return *this;}
};
struct Logger {};
template<typename M> struct Publisher {void publish(const M &);};
template<typename M> struct Subscription {using SharedPtr = std::shared_ptr<Subscription>;};
template<typename S> struct Client
{
  struct FutureAndRequestId {std::shared_ptr<typename S::Response> get();};
  bool wait_for_service(std::chrono::seconds);
  const char * get_service_name();
  FutureAndRequestId async_send_request(std::shared_ptr<typename S::Request>);
};
struct Node
{
  using SharedPtr = std::shared_ptr<Node>;
  explicit Node(const std::string &);
  Logger get_logger();
  const char * get_fully_qualified_name();
  template<typename M> std::shared_ptr<Publisher<M>> create_publisher(const std::string &, int);
  template<typename M, typename F> std::shared_ptr<Subscription<M>> create_subscription(const std::string &, QoS, F && take)
  {
    std::function<void(const M &)> checked = take;
    return nullptr;
  }
  template<typename S> std::shared_ptr<Client<S>> create_client(const std::string &);
};
enum class FutureReturnCode {SUCCESS, INTERRUPTED, TIMEOUT};
template<typename F> FutureReturnCode spin_until_future_complete(std::shared_ptr<Node>, F &, std::chrono::seconds);
void spin_some(std::shared_ptr<Node>);
void sleep_for(std::chrono::milliseconds);
struct InitOptions {};
enum class SignalHandlerOptions {All, None};
void init(int, char **, const InitOptions & = {}, SignalHandlerOptions = SignalHandlerOptions::All);
void spin(std::shared_ptr<Node>);
void shutdown();
}
#define RCLCPP_ERROR(logger, ...) static_cast<void>(logger), std::snprintf(nullptr, 0, __VA_ARGS__)
#define RCLCPP_INFO(logger, ...) static_cast<void>(logger), std::snprintf(nullptr, 0, __VA_ARGS__)
