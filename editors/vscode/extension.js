// Starts `pegbar lsp` and connects the editor with it; all else is the server's.
"use strict";

const vscode = require("vscode");
const { LanguageClient, TransportKind } = require("vscode-languageclient/node");

let client;

function start() {
  const settings = vscode.workspace.getConfiguration("pegbar");
  const command = settings.get("path") || "pegbar";
  const server = { command, args: ["lsp", ...settings.get("arguments", [])], transport: TransportKind.stdio };
  const options = {
    documentSelector: [
      { scheme: "file", language: "pegbar" },
      { scheme: "untitled", language: "pegbar" },
    ],
    synchronize: { fileEvents: vscode.workspace.createFileSystemWatcher("**/*.ron") },
  };
  client = new LanguageClient("pegbar", "Pegbar", server, options);
  return client.start().catch((error) => {
    const hint = `${command} lsp cannot be started: ${error.message}. Install pegbar, or say where it is in the setting pegbar.path.`;
    vscode.window.showErrorMessage(hint);
  });
}

async function restart() {
  if (client) await client.stop().catch(() => undefined);
  await start();
}

function activate(context) {
  const changed = (event) => ["pegbar.path", "pegbar.arguments"].some((name) => event.affectsConfiguration(name)) && restart();
  context.subscriptions.push(vscode.commands.registerCommand("pegbar.restart", restart), vscode.workspace.onDidChangeConfiguration(changed));
  return start();
}

function deactivate() {
  return client ? client.stop() : undefined;
}

module.exports = { activate, deactivate };
