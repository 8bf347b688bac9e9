// Starts `msnn lsp` for the specs of a workspace and shows what it says.

import { commands, ExtensionContext, window, workspace } from "vscode";
import { Executable, LanguageClient, LanguageClientOptions } from "vscode-languageclient/node";

let client: LanguageClient | undefined;

export async function activate(context: ExtensionContext): Promise<void> {
  context.subscriptions.push(
    commands.registerCommand("msnn.restart", restart),
    workspace.onDidChangeConfiguration((change) => {
      if (change.affectsConfiguration("msnn.command")) {
        void restart();
      }
    }),
  );
  await start();
}

export async function deactivate(): Promise<void> {
  await client?.stop();
  client = undefined;
}

async function restart(): Promise<void> {
  await deactivate();
  await start();
}

async function start(): Promise<void> {
  const [command, ...args] = workspace.getConfiguration("msnn").get<string[]>("command", []);
  if (command === undefined) {
    return;
  }
  const server: Executable = { command, args };
  const options: LanguageClientOptions = {
    documentSelector: [
      { language: "yaml", pattern: "**/*.msnn.{yaml,yml}" },
      { language: "json", pattern: "**/*.msnn.json" },
    ],
    // a sub-model, a robot or numbers that a spec reads may change outside of the editor
    synchronize: { fileEvents: workspace.createFileSystemWatcher("**/*.{yaml,yml,json,urdf,txt,csv}") },
  };
  client = new LanguageClient("msnn", "msnn", server, options);
  try {
    await client.start();
  } catch (error) {
    const reason = error instanceof Error ? error.message : String(error);
    void window.showErrorMessage(
      `msnn: \`${command}\` does not start (${reason}). Install msnn with its extra \`lsp\`, or name the program in the setting msnn.command.`,
    );
  }
}
