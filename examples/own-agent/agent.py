"""An agent in one file, with the standard library alone: Chat Completions, and MCP servers.

python agent.py MCP_CONFIG PROMPT IMAGE TRANSCRIPT MODEL, with $OPENAI_BASE_URL and $OPENAI_API_KEY.
The transcript is ATIF, written anew after every step.
"""

import base64
import json
import os
import subprocess
import sys
import urllib.request
from pathlib import Path


class Server:
    """An MCP server that is started for its client: one JSON-RPC message a line."""

    def __init__(self, how):
        env, command = {**os.environ, **how.get("env", {})}, [how["command"], *how.get("args", [])]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        self.process = subprocess.Popen(command, env=env, **pipes)
        client = {"name": "own-agent", "version": "1.0.0"}
        self.ask("initialize", protocolVersion="2025-06-18", capabilities={}, clientInfo=client)
        self.send(method="notifications/initialized")
        self.tools = self.ask("tools/list")["tools"]

    def send(self, **message):
        self.process.stdin.write(json.dumps({"jsonrpc": "2.0", **message}).encode() + b"\n")
        self.process.stdin.flush()

    def ask(self, method, **params):
        self.send(id=method, method=method, params=params)
        for line in self.process.stdout:
            answer = json.loads(line)
            if answer.get("id") == method and "method" not in answer:
                failed = {"content": [{"type": "text", "text": str(answer.get("error"))}]}
                return answer.get("result", failed)
        raise RuntimeError(f"the MCP server ended before it answered {method}")


def ask_model(model, messages, tools):
    body = json.dumps({"model": model, "messages": messages, "tools": tools}).encode()
    headers = {"Authorization": f"Bearer {os.environ['OPENAI_API_KEY']}"}
    headers["Content-Type"] = "application/json"
    url = os.environ["OPENAI_BASE_URL"] + "/chat/completions"
    with urllib.request.urlopen(urllib.request.Request(url, body, headers)) as answer:
        return json.load(answer)


def picture(data, kind="image/png"):
    return {"type": "image_url", "image_url": {"url": f"data:{kind};base64,{data}"}}


def main(config, prompt, image, transcript, model):
    servers = json.loads(Path(config).read_text())["mcpServers"].values()
    owner = {tool["name"]: (s, tool) for s in map(Server, servers) for tool in s.tools}
    tools = []
    for name, (_, tool) in owner.items():
        about = {"description": tool["description"], "parameters": tool["inputSchema"]}
        tools.append({"type": "function", "function": {"name": name, **about}})
    text = Path(prompt).read_text()
    photo = picture(base64.b64encode(Path(image).read_bytes()).decode())
    messages = [{"role": "user", "content": [{"type": "text", "text": text}, photo]}]
    steps, results = [{"step_id": 1, "source": "user", "message": text}], [None]
    while results:  # a model that calls no tool has finished
        answer = ask_model(model, messages, tools)
        said, results, calls, seen = answer["choices"][0]["message"], [], [], []
        messages.append(said)
        for call in said.get("tool_calls") or []:
            name, arguments = call["function"]["name"], json.loads(call["function"]["arguments"])
            parts = owner[name][0].ask("tools/call", name=name, arguments=arguments)["content"]
            text = "\n".join(part["text"] for part in parts if part["type"] == "text")
            seen += [picture(part["data"], part["mimeType"]) for part in parts if "data" in part]
            messages.append({"role": "tool", "tool_call_id": call["id"], "content": text})
            results.append({"source_call_id": call["id"], "content": text})
            about = {"function_name": name, "arguments": arguments}
            calls.append({"tool_call_id": call["id"], **about})
        if seen:  # in this API a tool's answer is text alone
            messages.append({"role": "user", "content": seen})
        used = {key: answer["usage"][key] for key in ("prompt_tokens", "completion_tokens")}
        step = {"step_id": len(steps) + 1, "source": "agent", "message": said["content"] or ""}
        made = {"tool_calls": calls, "observation": {"results": results}}
        steps.append({**step, "metrics": used, **made})
        agent = {"name": "own", "version": "1.0.0", "model_name": answer["model"]}
        document = {"schema_version": "ATIF-v1.6", "session_id": "own", "agent": agent}
        Path(transcript).write_text(json.dumps({**document, "steps": steps}))


if __name__ == "__main__":
    main(*sys.argv[1:])
